"""Colours of a moment of a trial, in figures and in the page's player alike.

Those of strategies are in `baselines/colors.py`.
"""

from __future__ import annotations

UNKNOWN, FREE, OCCUPIED = "#d9d9d9", "#ffffff", "#707070"
TRUE, ESTIMATE, ELLIPSE = "#000000", "#2ca02c", "#4878a8"
LANDMARK, CANDIDATE, CHOSEN, RANGE = "#e8b500", "#8a2be2", "#e3001b", "#9fd3ee"
LOOP = "#0072b2"
