"""`list`: what there is."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

from explore_bench.errors import RequestError

if TYPE_CHECKING:
    from explore_bench.strategies.entry import Entry


@click.command("list")
@click.argument("what", type=click.Choice(["strategies", "scenarios", "suites", "metrics"]), default="strategies")
def list_(what: str) -> None:
    """List strategies (the default), scenarios, suites or metrics."""
    rows: list[tuple[str, ...]]
    notes: list[str] = []
    if what == "strategies":
        from explore_bench.strategies.registry import strategies

        rows = [("name", "label", "tables and suites", "state", "parameters")]
        for name, entry in strategies().items():
            state, count, note = _state(entry)
            rows.append((name, entry.label, ", ".join((*entry.tables, *entry.suites)) or "–", state, count))
            notes += [f"{name}: {note}"] if note else []
    elif what == "scenarios":
        from explore_bench.world.scenarios import SCENARIOS

        rows = [("name", "description"), *((name, text) for name, (_, text) in SCENARIOS.items())]
    elif what == "suites":
        from explore_bench.runs.suites import SUITES

        rows = [("name", "sizes [m]", "worlds", "description")]
        for name, suite in SUITES.items():
            sizes = ", ".join(f"{size:g}" for size in suite.sizes)
            rows.append((name, sizes, str(suite.trials), suite.description))
    else:
        from explore_bench.analysis.metrics import METRICS, REGRETS, metrics_of
        from explore_bench.world.kinds import KINDS

        rows = [("name", "symbol", "unit", "better", "worlds", "definition")]
        listed = {
            "all": METRICS | {name: metric for name, (_, metric) in REGRETS.items()},
            **{kind: metrics_of(kind) for kind in KINDS},
        }
        for worlds, metrics in listed.items():
            for name, metric in metrics.items():
                rows.append((name, metric.symbol, metric.unit, metric.better or "–", worlds, metric.equation))
    widths = [max(len(row[i]) for row in rows) for i in range(len(rows[0]))]
    for row in rows:
        click.echo("  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip())
    for note in notes:
        click.echo(note)


def _state(entry: Entry) -> tuple[str, str, str]:
    """Whether a strategy can run, the number of its parameters where it is learned, and what is wrong with it."""
    from explore_bench.strategies.registry import parameter_count

    if entry.broken:
        return "broken", "", entry.broken
    if entry.reference:
        return "reference: told the truth", "", ""
    if not entry.weights:
        return "ready" if entry.ready else "not trained", "", ""
    seeds = len(entry.weights)
    state = f"learned, {seeds} training seed{'s' if seeds > 1 else ''}"
    try:
        return state, f"{parameter_count(entry):,}", ""
    except RequestError as error:
        return state, "", str(error)
