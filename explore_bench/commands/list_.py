"""`list`: what there is."""

from __future__ import annotations

import click


@click.command("list")
@click.argument("what", type=click.Choice(["strategies", "scenarios", "suites", "metrics"]), default="strategies")
def list_(what: str) -> None:
    """List strategies (the default), scenarios, suites or metrics."""
    rows: list[tuple[str, ...]]
    if what == "strategies":
        from explore_bench.registry import parameter_count, strategies

        rows = [("name", "label", "tables", "state", "parameters")]
        for name, entry in strategies().items():
            state, count = "ready" if entry.ready else "not trained", ""
            if entry.reference:
                state = "reference: told the truth"
            elif entry.weights:
                seeds = len(entry.weights)
                state = f"learned, {seeds} training seed{'s' if seeds > 1 else ''}"
                count = f"{parameter_count(entry):,}"
            rows.append((name, entry.label, ", ".join(entry.tables), state, count))
    elif what == "scenarios":
        from explore_bench.scenario import SCENARIOS

        rows = [("name", "description"), *((name, text) for name, (_, text) in SCENARIOS.items())]
    elif what == "suites":
        from explore_bench.suites import SUITES

        rows = [("name", "sizes [m]", "worlds", "description")]
        for name, suite in SUITES.items():
            sizes = ", ".join(f"{size:g}" for size in suite.sizes)
            rows.append((name, sizes, str(suite.trials), suite.description))
    else:
        from explore_bench.metrics import METRICS, REGRET

        rows = [("name", "symbol", "unit", "better", "definition")]
        for name, metric in (METRICS | {"regret": REGRET}).items():
            rows.append((name, metric.symbol, metric.unit, metric.better or "–", metric.equation))
    widths = [max(len(row[i]) for row in rows) for i in range(len(rows[0]))]
    for row in rows:
        click.echo("  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip())
