"""The confirmation: attempts are declared before, each root seed is used once, and what came out stays."""

import hashlib
import importlib.util
import json
import sys
from pathlib import Path

import pytest

from explore_bench import RequestError
from explore_bench.strategies.registry import strategies

FILE = Path(__file__).parents[1] / "docs/studies/confirm.py"
ATTEMPT = """
[[attempt]]
root = {root}
better = "{better}"
metrics = ["trajectory_error", "exploration_efficiency"]
sizes = [20]
worlds = {worlds}
"""


@pytest.fixture
def confirm(monkeypatch):
    spec = importlib.util.spec_from_file_location("confirm", FILE)
    module = importlib.util.module_from_spec(spec)
    monkeypatch.setitem(sys.modules, "confirm", module)  # its dataclass looks itself up
    spec.loader.exec_module(module)
    return module


def declare(folder, *attempts):
    text = "".join(ATTEMPT.format(**{"better": "nearest", "worlds": 2, **one}) for one in attempts)
    (folder / "attempts.toml").write_text(text)
    return folder / "attempts.toml"


def ran(confirm, monkeypatch, capsys, folder, *options):
    monkeypatch.setattr(sys, "argv", ["confirm.py", "--out", str(folder), *options])
    confirm.main()
    return capsys.readouterr().out.splitlines()


@pytest.mark.parametrize("roots", [(7, 7), (0,), (1, 2, 1)])
def test_a_root_seed_is_used_once_and_the_benchmarks_own_never(roots, confirm, tmp_path):
    with pytest.raises(RequestError, match="is used twice"):
        confirm.attempts(declare(tmp_path, *({"root": root} for root in roots)))


def test_the_family_is_everybody_else_at_every_size_in_every_metric(confirm, tmp_path):
    (attempt,) = confirm.attempts(declare(tmp_path, {"root": 7, "better": "belief-attention"}))
    claim = confirm.claim_of(attempt)
    others = {
        name
        for name, entry in strategies().items()
        if not entry.reference and "landmark" in (entry.kinds or ("landmark",))
    }
    compared = {one.worse for one in claim.comparisons}
    assert compared == others - {"belief-attention"}
    assert len(claim.comparisons) == 2 * len(compared)
    assert {one.better for one in claim.comparisons} == {"belief-attention"}
    assert not claim.architecture


def test_the_declared_attempts_of_the_project_are_in_order(confirm):
    for attempt in confirm.attempts(confirm.FOLDER / "attempts.toml"):
        assert attempt.worlds == 200
        assert attempt.sizes == (20.0, 30.0, 40.0)


@pytest.mark.slow
def test_an_attempt_is_run_once_and_its_answer_stays(confirm, monkeypatch, capsys, tmp_path):
    monkeypatch.setattr(confirm, "others", lambda attempt: ["random", "entropy"])
    declare(tmp_path, {"root": 7, "worlds": 12})
    assert ran(confirm, monkeypatch, capsys, tmp_path, "--check") == ["7: 4 comparisons, not run yet"]
    assert not (tmp_path / "7.md").exists()
    last = ran(confirm, monkeypatch, capsys, tmp_path, "--workers", "2")[-1]
    assert last == (tmp_path / "7.md").read_text().splitlines()[0].removeprefix("## ")
    found = json.loads((tmp_path / "7.json").read_text())
    assert last.startswith(f"7: {found['verdict']}. Of 4 comparisons: ")
    of_random = [one["verdict"] for one in found["comparisons"] if one["comparison"]["worse"] == "random"]
    assert of_random == ["supported", "supported"]
    keys = "".join(sorted(file.stem for file in (tmp_path / "7" / "runs").glob("*.parquet")))
    assert found["keys"] == hashlib.sha256(keys.encode()).hexdigest()[:20]
    assert f"`{found['keys']}`" in (tmp_path / "7.md").read_text()
    (tmp_path / "7.md").write_text("## 7: what was said then\n")
    assert ran(confirm, monkeypatch, capsys, tmp_path) == ["7: what was said then"]
    assert ran(confirm, monkeypatch, capsys, tmp_path, "--check") == ["7: what was said then"]
