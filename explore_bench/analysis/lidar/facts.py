"""What the world of a trial is like: a line of worlds.csv."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from explore_bench.world.lidar.facts import facts_of

if TYPE_CHECKING:
    from explore_bench.records.encoding import TrialRecord


def facts(record: TrialRecord) -> dict[str, Any]:
    """Scene of a trial's world ("map" for a given one), and its Facts for the range of the trial's lidar."""
    scenario: Any = record.spec.scenario
    scene = scenario.scene if scenario.map is None else "map"
    return {"scene": scene, **facts_of(record.world, scenario.sensor_range)._asdict()}  # type: ignore[arg-type]
