"""Tune one constant of each rule of the field that has one, on calibration worlds: the same budget for all.

Worlds and objective are those of path_weights.py, with which the project's own rules were tuned, and so is the
number of values, the largest there. What a rule has without tuning is among them. Run again with

    python docs/studies/field_tuning.py [--store FOLDER] [--workers N] [STRATEGY ...]

It resumes from its store and writes field-tuning.csv beside this file; docs/field.md tells more.
"""

from __future__ import annotations

from pathlib import Path

from path_weights import Sweep, tune

SWEEPS = {
    "information-gain": Sweep("gain", (0.5, 1.0, 3.0, 6.0, 12.0, 24.0, 48.0, 96.0, 192.0, 384.0)),
    "next-best-view": Sweep("decay", (0.01, 0.02, 0.05, 0.1, 0.15, 0.2, 0.3, 0.5, 1.0, 2.0)),  # 1/m
    "heading-aware": Sweep("decay", (0.01, 0.02, 0.04, 0.07, 0.1, 0.15, 0.2, 0.3, 0.6, 1.2)),  # 1/m
    "cost-utility": Sweep("distance", (0.1, 0.2, 0.3, 0.5, 1.0, 3.0, 10.0, 30.0, 100.0, 300.0)),
    "makarenko": Sweep("navigation", (0.125, 0.25, 0.5, 0.75, 1.0, 1.5, 2.0, 3.0, 4.0, 8.0)),
    "distance-advantage": Sweep("distance", (0.25, 0.5, 0.75, 1.0, 1.5, 2.0, 3.0, 4.0, 6.0, 8.0)),
    "entropy-reduction": Sweep("prior", (0.01, 0.02, 0.05, 0.1, 0.2, 0.3, 0.4, 0.5, 0.7, 0.9)),
    "potential-field": Sweep("revisit", (0.0, 0.05, 0.1, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 40.0)),
    "joint-entropy": Sweep("weight", (0.0, 0.25, 0.5, 1.0, 2.0, 4.0, 8.0, 16.0, 32.0, 64.0)),  # nat/m
}


if __name__ == "__main__":
    tune(__doc__, SWEEPS, Path(__file__).with_name("field-tuning.csv"))
