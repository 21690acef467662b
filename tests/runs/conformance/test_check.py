"""`explore-bench check`: a line a rule, the exit code, and the same as JSON."""

import json
from pathlib import Path

import faulty_strategies
import pytest

from explore_bench.cli import main
from explore_bench.runs.conformance import RULES

FILE = Path(faulty_strategies.__file__)


@pytest.fixture
def call(capsys):
    """Return a function that runs the command and returns its exit code, its lines and its complaints."""

    def run(*arguments):
        with pytest.raises(SystemExit) as ended:
            main(["check", "--timeout", "600", *[str(argument) for argument in arguments]])
        captured = capsys.readouterr()
        return ended.value.code, captured.out.splitlines(), captured.err

    return run


def test_a_sound_strategy_ends_with_0_and_a_line_for_each_rule_and_none_of_what_it_prints(call, tmp_path):
    file = tmp_path / "loud.py"
    file.write_text(
        "print('imported')\n"
        "class Loud:\n"
        "    def __init__(self): print('made')\n"
        "    def reset(self, rng): print('reset')\n"
        "    def choose(self, observation):\n"
        "        print('choose')\n"
        "        return 0\n"
    )
    code, lines, _ = call(f"{file}:Loud", "--json", tmp_path / "found.json")
    assert code == 0
    assert [line.split()[:2] for line in lines[:-1]] == [["ok", rule.name] for rule in RULES]
    assert lines[-1].startswith(f"{file}:Loud: keeps the contract (")
    written = json.loads((tmp_path / "found.json").read_text())
    assert written["strategy"] == f"{file}:Loud" and written["ok"]
    assert [one["sentence"] for one in written["findings"]] == [rule.sentence for rule in RULES]


def test_a_faulty_one_ends_with_1_and_says_what_happened(call, tmp_path):
    code, lines, _ = call(f"{FILE}:AnswersFloat", "--json", tmp_path / "found.json")
    assert code == 1
    (line,) = [line for line in lines if line.startswith("broken")]
    rule = "It answers an integer, or a Target: no bool, no float, no None."
    assert f"{rule} 20 m, decision 0: it answered np.float64(1.0)" in line
    assert f"1 of {len(RULES)} rules broken" in lines[-1]
    written = json.loads((tmp_path / "found.json").read_text())
    assert not written["ok"]
    assert {one["rule"]: one["verdict"] for one in written["findings"]}["integer"] == "broken"


def test_no_such_strategy_ends_with_2(call):
    for name, words in (
        ("nearst", "did you mean 'nearest'?"),
        ("./none.py:A", "there is no file none.py"),
        (f"{FILE}:A", "has no 'A'"),
    ):
        code, lines, complaint = call(name)
        assert code == 2
        assert lines == []
        assert complaint.count("\n") == 1 and words in complaint


def test_a_file_that_cannot_be_written_ends_with_2(call, tmp_path):
    code, _, complaint = call(f"{FILE}:NoReset", "--json", tmp_path / "no" / "such.json")
    assert code == 2
    assert "cannot be written" in complaint
