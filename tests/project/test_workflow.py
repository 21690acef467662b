"""The workflow that users copy: valid, and every command in it exists with these options and covers the reference."""

import re
import shlex
from pathlib import Path

import click
import pytest

from explore_bench.analysis.gate.accepted import read_accepted
from explore_bench.cli import cli

ROOT = Path(__file__).parents[2]
WORKFLOW = ROOT / ".github" / "workflows" / "benchmark.yml"


@pytest.fixture(scope="module")
def job():
    yaml = pytest.importorskip("yaml", reason="PyYAML is not installed")
    document = yaml.safe_load(WORKFLOW.read_text(encoding="utf-8"))
    assert document[True].keys() == {"pull_request", "push"}, "YAML reads `on` as true"
    assert document["permissions"] == {"contents": "read"}
    (job,) = document["jobs"].values()
    return job


def parsed(line):
    """Return the name of a command and its parameters as the command line understands them; it refuses others."""
    program, name, *arguments = shlex.split(line)
    assert program == "explore-bench"
    command = cli.get_command(click.Context(cli), name)
    assert command is not None, name
    return name, command.make_context(name, arguments).params


def commands(texts):
    return dict(parsed(text) for text in texts if text.startswith("explore-bench"))


def makefile(target):
    """Return the commands of a target of the Makefile by their results folder and name."""
    text = (ROOT / "Makefile").read_text().replace("\\\n", " ")
    (variable,), (recipe,) = (re.findall(form, text, re.M) for form in (r"^gated = (.*)$", rf"^{target}:.*\n\t(.*)$"))
    lines = re.findall(r"explore-bench [^;&)]+", recipe.replace("$(gated)", variable).replace("$(REASON)", "why"))
    return {(str(found["results"]), name): found for name, found in map(parsed, lines)}


def assert_covers_the_reference(found):
    known = read_accepted(ROOT / found["gate"]["reference"])
    assert set(found["run"]["names"]) == {one.strategy for one in known.family}
    assert found["run"]["trials"] == known.trials["trial"].nunique()
    assert found["run"]["suite"] == "smoke"
    assert found["run"]["results"] == found["gate"]["results"]


def test_the_workflow_installs_runs_gates_reports_and_uploads(job):
    steps = job["steps"]
    found = commands(step.get("run", "") for step in steps)
    assert list(found) == ["run", "gate", "report"]
    assert_covers_the_reference(found)
    assert [step["uses"].split("@")[0] for step in steps if "uses" in step] == [
        "actions/checkout",
        "actions/setup-python",
        "actions/upload-artifact",
    ]
    folder = found["gate"]["results"]
    uploaded = steps[-1]["with"]["path"].split()
    assert [str(folder / name) for name in ("report.html", "trials.csv", "gate.json")] == uploaded
    assert str(found["gate"]["file"]) in uploaded
    assert found["report"]["results"] == folder


def test_a_failed_trial_or_gate_still_leaves_a_report(job):
    after = [
        step for step in job["steps"] if step.get("name") in ("Gate", "Report") or "upload" in step.get("uses", "")
    ]
    assert [step["if"] for step in after] == ["${{ !cancelled() }}"] * 3


def test_nothing_is_installed_that_the_constraints_do_not_pin(job):
    (install,) = [step["run"] for step in job["steps"] if step.get("name") == "Install"]
    assert install == "pip install --constraint constraints.txt ."
    assert (ROOT / job["steps"][1]["with"]["cache-dependency-path"]).is_file()


@pytest.mark.parametrize("target", ["gate", "accept"])
def test_make_gate_runs_what_the_references_hold_in_both_kinds_of_world_and_make_accept_renews_them(target):
    found = makefile(target)
    places = ("results/gate", "results/gate/stage")
    assert list(found) == [(place, name) for name in ("run", "gate") for place in places]
    for place, scenario in zip(places, (None, "stage"), strict=True):
        own = {name: found[place, name] for name in ("run", "gate")}
        assert_covers_the_reference(own)
        assert own["run"]["scenario"] == scenario
        assert own["gate"]["reason"] == ("why" if target == "accept" else None)
    assert len({str(found[place, "gate"]["reference"]) for place in places}) == 2
