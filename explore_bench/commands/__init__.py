"""The commands, a module each; heavy libraries are imported inside a command, so `--help` feels instant.

Exit codes: 0 done; 1 it ran and the answer is no (a trial failed, say); 2 the request or a file is wrong; 3 incomplete,
or nothing was measured; 130 interrupted.
"""

from __future__ import annotations

from pathlib import Path

import click

DONE, NO, WRONG, INCOMPLETE, INTERRUPTED = 0, 1, 2, 3, 130

results_option = click.option(
    "--results",
    type=click.Path(path_type=Path),
    default=Path("results"),
    show_default=True,
    help="Folder of records, tables and figures.",
)
scenario_option = click.option(
    "--scenario", metavar="NAME|FILE.toml", help="Physical constants instead of the paper's."
)
root_option = click.option(
    "--seed", type=int, default=0, show_default=True, metavar="ROOT", help="Root seed; 0 is the benchmark's."
)
json_option = click.option(
    "--json", "file", type=click.Path(path_type=Path), metavar="FILE", help="Write the numbers as JSON, too."
)
