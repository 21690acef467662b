"""The report of a folder of several lidar scenarios: its page, figures, claims and what the player offers."""

import json
import re

import pytest
from lidar_worlds import SMALL

from explore_bench.analysis.claims import Claim, comparisons
from explore_bench.records.store import Store
from explore_bench.report.render import write_report
from explore_bench.runs.suites import plan
from explore_bench.trial.run import run_trial

CLAIM = Claim("x", "Random drives less.", comparisons("random", ["nearest"], ["l90"], (8.0,)), scenario="short sight")


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Return a folder of two strategies in two worlds under two sets of constants, and the files of its report."""
    store = Store(tmp_path_factory.mktemp("page") / "results")
    store.open(0, "evaluate", None)
    for name, scenario in (("long sight", SMALL), ("short sight", SMALL.replace(sensor_range=2.5))):
        for spec in plan("smoke", ["nearest", "random"], [8.0], 2, scenario=scenario, scenario_name=name).specs:
            store.write(run_trial(spec))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("explore_bench.analysis.claims.claims", lambda: (CLAIM,))
        files = write_report(store.folder).files
    return store.folder, {str(file.relative_to(store.folder)) for file in files}


def test_it_has_a_page_the_tables_of_its_kind_figures_and_no_mean_over_different_physics(folder):
    _, files = folder
    assert {"trials.csv", "worlds.csv", "report.html", "claims.md", "tables/stage.md", "tables/claims.md"} <= files
    assert {"figures/stage-ranking.svg", "figures/figure-16a.svg", "figures/figure-16b.svg"} <= files
    assert "summary.csv" not in files
    assert not any("table2" in file or "sensitivity" in file for file in files)


def test_the_player_offers_every_scenario_as_a_map_of_its_own(folder):
    path, _ = folder
    data = json.loads(
        re.search(r'<script[^>]*id="replays"[^>]*>(.*?)</script>', (path / "report.html").read_text()).group(1)
    )
    assert sorted(data["maps"]) == ["8 m × 8 m, long sight", "8 m × 8 m, short sight"]
    offered = {(trial["strategy"], trial["map"], trial["world"]) for trial in data["trials"]}
    assert offered == {(strategy, place, world) for strategy in (0, 1) for place in (0, 1) for world in (0, 1)}


def test_a_claim_is_about_its_scenario_alone(folder):
    path, _ = folder
    [claim] = json.loads((path / "claims.json").read_text())
    [comparison] = claim["comparisons"]
    assert comparison["n"] == 2
    assert "L90" in comparison["sentence"]
    assert "Random drives less." in (path / "report.html").read_text()


def test_the_same_folder_gives_the_same_page(folder):
    path, _ = folder
    before = (path / "tables" / "stage.md").read_bytes(), (path / "figures" / "stage-ranking.svg").read_bytes()
    write_report(path)
    assert before == (
        (path / "tables" / "stage.md").read_bytes(),
        (path / "figures" / "stage-ranking.svg").read_bytes(),
    )
