"""Hooks of mkdocs: of which files the site is made.

Pages link to one another, and to files beside `docs/`, as they lie in the repository, so that links hold on GitHub.
The site keeps these places: it has README.md and its like, the pages of `docs/`, and whatever these
and further pages link to; of a folder, a page that lists its files. The API and a page of each suite are written here,
from docstrings, `runs/suites.py` and the stored results.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pandas as pd
from mkdocs.structure.files import File, Files

sys.path.insert(0, str(Path(__file__).parent))

from fill import PLAIN, ROOT, markdown as table_of

import explore_bench
from explore_bench.analysis.metrics import METRICS, REGRETS, metrics_of
from explore_bench.analysis.statistics import Estimate
from explore_bench.records.provenance import installed_version, scenario_digest
from explore_bench.report.tables import heading, interval_text
from explore_bench.runs.suites import SUITES, Suite
from explore_bench.strategies.registry import strategies
from explore_bench.trial.steps import SCHEMA_VERSION
from explore_bench.world.scenario import Scenario
from explore_bench.world.scenarios import PAPER, SCENARIOS

LINK = re.compile(r"(?<=\]\()(?!\w+:|#)([^)\s#]+)(?=[)#])")
"""Target of a relative link, without its anchor."""

SCORES = ("trajectory_error", "exploration_efficiency")
"""Metrics whose means the page of a suite shows; its summary.csv has all."""


def on_files(files: Files, config: Any) -> Files:
    """Replace the pages that mkdocs found by those of the site; the theme's own files stay."""
    texts = {"api.md": _api(), "suites.md": _suites(), **{f"suites/{name}.md": _suite(name) for name in SUITES}}
    waiting = ["README.md", "CONTRIBUTING.md", "CHANGELOG.md", "AGENTS.md", *_pages(ROOT / "docs")]
    for name, text in texts.items():
        waiting += _linked(text, (ROOT / name).parent)
    found: set[str] = set()
    while waiting:
        name = waiting.pop()
        path = ROOT / name
        if name in found:
            continue
        found.add(name)
        if path.is_dir():
            texts[f"{name}/index.md"] = _folder(path)
            waiting += _linked(texts[f"{name}/index.md"], path)
        elif path.suffix == ".md":
            waiting += _linked(path.read_text(encoding="utf-8"), path.parent)
    own = [
        File(name, str(ROOT), config.site_dir, config.use_directory_urls)
        for name in sorted(found)
        if (ROOT / name).is_file()
    ]
    own += [File.generated(config, name, content=text) for name, text in texts.items()]
    return Files([*(file for file in files if file.src_dir != config.docs_dir), *own])


def on_page_markdown(markdown: str, page: Any, **_: Any) -> str:
    """Let links to a folder lead to the page that lists it."""
    folder = (ROOT / page.file.src_uri).parent

    def target(match: re.Match[str]) -> str:
        return f"{match[1].rstrip('/')}/index.md" if (folder / match[1]).is_dir() else match[1]

    return LINK.sub(target, markdown)


def _pages(folder: Path) -> list[str]:
    return [path.relative_to(ROOT).as_posix() for path in sorted(folder.glob("*.md"))]


def _linked(text: str, folder: Path) -> Iterator[str]:
    """Yield the files and folders of the repository that the links of a text in a folder name."""
    for target in LINK.findall(text):
        path = (folder / target).resolve()
        if path != ROOT and path.is_relative_to(ROOT) and path.exists():
            yield path.relative_to(ROOT).as_posix()


def _folder(folder: Path) -> str:
    """Page of a folder: its README.md, where it has one, and its files."""
    own = folder / "README.md"
    if own.is_file():
        return own.read_text(encoding="utf-8")
    files = [path.name for path in sorted(folder.iterdir()) if path.is_file() and not path.name.startswith(".")]
    folders = [path.name for path in sorted(folder.iterdir()) if (path / "README.md").is_file()]
    lines = [f"- [`{name}`]({name})" for name in (*folders, *files)]
    return "\n".join((f"# {folder.relative_to(ROOT).as_posix()}", "", *lines, ""))


def _api() -> str:
    """Page of all public names, from their docstrings."""
    parts = [
        "# API",
        "",
        "`from explore_bench import NAME` gives these. [Your own strategy](docs/plugins.md) uses them.",
    ]
    for name, module in explore_bench.PUBLIC.items():
        parts += ["", f"::: explore_bench.{module}.{name}", "", *([PLAIN[name]] if name in PLAIN else [])]
    return "\n".join(parts)


def _suites() -> str:
    rows = [
        {
            "suite": f"[`{name}`](suites/{name}.md)",
            "what": suite.description,
            "sizes [m]": ", ".join(f"{size:g}" for size in suite.sizes),
            "worlds a size": suite.trials,
        }
        for name, suite in SUITES.items()
    ]
    return f"# Suites\n\n`explore-bench run SUITE` runs one of them.\n\n{table_of(pd.DataFrame(rows))}\n"


def _suite(name: str) -> str:
    """Page of a suite: its version, what a strategy observes, its metrics, and the scores that are stored."""
    suite = SUITES[name]
    base = PAPER if suite.scenario is None else SCENARIOS[suite.scenario][0]
    constants = [{"constant": f"`{key}`", "value": value} for key, value in base.model_dump().items() if key != "map"]
    seeds = "all" if suite.seeds is None else f"the first {suite.seeds}" if suite.seeds > 1 else "the first"
    sizes = ", ".join(f"{size:g}" for size in suite.sizes)
    return f"""# Suite {name}

{suite.description[0].upper()}{suite.description[1:]}. Sizes: {sizes} m; {suite.trials} worlds a size; training seeds of
a learned strategy: {seeds}.

## Version

explore-bench {installed_version("explore-bench")}, record version {SCHEMA_VERSION}; its constants have the digest
`{scenario_digest(base)}`. A trial is stored under the digest of all that defines it
([what counts](../docs/plugins.md#what-counts-and-when-trials-run-again)).

{table_of(pd.DataFrame(constants))}

{_variations(suite)}
## Observation

A strategy sees an [`Observation`][explore_bench.strategies.contract.Observation] in a world of the kind `{base.kind}`:
sensor range {base.sensor_range:g} m, other constants above. {_fine(base)}

## Metrics

{_metrics(base.kind)}

## Reference scores

{_scores(name, suite)}
"""


def _variations(suite: Suite) -> str:
    if not suite.variations:
        return ""
    rows = [
        {
            "kept as": name,
            "changes": ", ".join(f"`{key}` = {'a given map' if key == 'map' else value}" for key, value in own.items()),
        }
        for name, own in suite.variations.items()
    ]
    return f"Every world is run under each of these:\n\n{table_of(pd.DataFrame(rows))}\n"


def _fine(base: Scenario) -> str:
    if base.kind == PAPER.kind:
        return "`belief.fine` is None: the map of the robot has the cells of the grid of decisions."
    return "`belief.fine` is the map of the robot, finer than the grid of decisions ([lidar worlds](../docs/stage.md))."


def _metrics(kind: str) -> str:
    shown = METRICS | {name: metric for name, (_, metric) in REGRETS.items()} | metrics_of(kind)
    rows = [
        {
            "column": f"`{name}`",
            "symbol": metric.symbol,
            "unit": metric.unit,
            "better": metric.better or "–",
            "definition": metric.equation,
        }
        for name, metric in shown.items()
    ]
    return table_of(pd.DataFrame(rows))


def _scores(name: str, suite: Suite) -> str:
    """Means of the stored trials, or the table that a report of the suite wrote."""
    own = Path("results", name)
    for table in ("sensitivity", "maps", "stage") if suite.variations else ():
        file = own / "tables" / f"{table}.md"
        if (ROOT / file).is_file():
            return f"{(ROOT / file).read_text(encoding='utf-8')}\nFrom [{file}](../{file})."
    summary = own / "summary.csv" if suite.scenario or suite.variations else Path("results", "summary.csv")
    if not (ROOT / summary).is_file():
        return f"None are stored: `explore-bench run {name} --results results/{name}` makes them."
    scores = pd.read_csv(ROOT / summary).drop_duplicates(["strategy", "size", "metric"])
    scores = scores.set_index(["strategy", "size", "metric"])
    rows = [row for key, entry in strategies().items() if (row := _row(key, suite.sizes_of(entry), scores))]
    worlds = int(scores["n"].max())
    return (
        f"Means over {worlds} worlds a size with 95 % intervals; a reference fills the columns that it plans for. From "
        f"[{summary}](../{summary}), which has all metrics.\n\n{table_of(pd.DataFrame(rows).fillna('–'))}"
    )


def _row(strategy: str, sizes: tuple[float, ...], scores: pd.DataFrame) -> dict[str, str]:
    """Scores of a strategy at those sizes; empty where none are stored."""
    entry, cells = strategies()[strategy], {}
    for metric in SCORES:
        for size in sizes:
            if (strategy, size, metric) in scores.index:
                line = scores.loc[(strategy, size, metric)]
                estimate = Estimate(line["mean"], line["ci_low"], line["ci_high"], int(line["n"]))
                cell = interval_text(estimate) if entry.fills(metric) else "–"
                cells[f"{heading(METRICS[metric])} {size:g} m"] = cell
    return {"strategy": f"`{strategy}`", "Method": entry.label, **cells} if cells else {}
