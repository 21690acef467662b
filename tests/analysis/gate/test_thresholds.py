"""The declared family: what is read, and each wrong file in one sentence with the value and the fix."""

import pytest

from explore_bench.analysis.gate.thresholds import MAX_PAIRS, TIMES, load_thresholds
from explore_bench.analysis.times import TIME_COLUMNS
from explore_bench.errors import RequestError

GOOD = {
    "metric": '"trajectory_error"',
    "strategy": '"Mine"',
    "size": "20.0",
    "tolerance": "0.05",
    "reason": '"a robot that is lost is of no use"',
}


def entry(**changes):
    lines = (GOOD | changes).items()
    return "[[threshold]]\n" + "".join(f"{key} = {value}\n" for key, value in lines if value)


@pytest.fixture
def load(tmp_path):
    def read(text):
        path = tmp_path / "thresholds.toml"
        path.write_bytes(text if isinstance(text, bytes) else text.encode())
        return load_thresholds(path)

    return read


def test_a_family_is_read_in_its_order(load):
    first, second = load(entry() + entry(metric='"exploration_efficiency"', direction='"higher"', scenario='"wide"'))
    assert (first.metric, first.strategy, first.size, first.tolerance) == ("trajectory_error", "Mine", 20.0, 0.05)
    assert (first.sign, first.place) == (1.0, "Mine, 20 m, paper")
    assert (second.sign, second.place, second.scenario) == (-1.0, "Mine, 20 m, wide", "wide")


def test_a_reference_is_gated_in_what_it_plans_for(load):
    assert load(entry(strategy='"clairvoyant-accurate"'))[0].strategy == "clairvoyant-accurate"


def test_whole_numbers_are_sizes_too(load):
    assert load(entry(size="30"))[0].size == 30.0


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"metric": '"exploration_eficiency"'}, "metric 'exploration_eficiency' is unknown; did you mean"),
        ({"metric": '"decision_ms"'}, "metric 'decision_ms' is a time, .* never gated; drop it"),
        ({"metric": '"seconds"'}, "metric 'seconds' is a time"),
        ({"metric": '"decisions"'}, "metric 'decisions' is better in no direction; gate one of trajectory_error"),
        (
            {"strategy": '"clairvoyant"'},
            "metric 'trajectory_error' is none that the reference 'clairvoyant' plans for; gate",
        ),
        ({"direction": '"higher"'}, "direction of trajectory_error is 'higher', but by its definition lower"),
        ({"direction": '"up"'}, "threshold 1: direction is 'up'; input should be 'lower' or 'higher'"),
        ({"tolerance": "5"}, "threshold 1: tolerance is 5; .*less than 1, a share such as 0.05"),
        ({"tolerance": "0.0"}, r"threshold 1: tolerance is 0\.0; .*greater than 0"),
        ({"tolerance": "nan"}, "threshold 1: tolerance is nan"),
        ({"tolerance": '"5 %"'}, "threshold 1: tolerance is '5 %'; .*share such as 0.05"),
        ({"tolerance": ""}, "threshold 1: tolerance is missing; write it"),
        ({"size": "inf"}, "threshold 1: size is inf"),
        ({"size": "true"}, "threshold 1: size is True"),
        ({"reason": '""'}, "threshold 1: reason is ''"),
        ({"reason": ""}, "threshold 1: reason is missing"),
        ({"tolerence": "0.1"}, "threshold 1: key 'tolerence' is unknown; did you mean 'tolerance'"),
    ],
)
def test_a_wrong_value_is_named_with_the_fix(load, changes, words):
    with pytest.raises(RequestError, match=r"thresholds\.toml': " + words) as error:
        load(entry(**changes))
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "threshold is missing"),
        ("threshold = []", "declares no threshold; write"),
        ("threshold = 5", "threshold is 5"),
        ("[[threshold]", "is not TOML, .* write lines like"),
        (b"\xff\xfe", "it is not UTF-8 text"),
        (entry() + entry(tolerance="0.1"), "trajectory_error of 'Mine' at 20 m is declared twice; keep one"),
        ("max_pairs = 0\n" + entry(), "max_pairs is 0"),
        ("thresholds = 1\n" + entry(), "key 'thresholds' is unknown; did you mean 'threshold'"),
    ],
)
def test_a_file_that_is_no_family_is_refused(load, text, words):
    with pytest.raises(RequestError, match=words) as error:
        load(text)
    assert "\n" not in str(error.value)


def test_a_file_that_is_not_there_is_refused(tmp_path):
    with pytest.raises(RequestError, match=r"none\.toml' cannot be read \(No such file.*docs/gate\.md"):
        load_thresholds(tmp_path / "none.toml")


def test_a_large_family_has_to_be_meant(load):
    many = "".join(entry(size=str(20 + 2 * i)) for i in range(MAX_PAIRS + 1))
    with pytest.raises(RequestError, match=r"7 pairs are more than max_pairs 6.*write max_pairs = 7"):
        load(many)
    assert len(load("max_pairs = 7\n" + many)) == 7


def test_every_column_of_times_is_refused():
    assert {name for name in TIME_COLUMNS if name.endswith(("seconds", "_ms", "_ms_max"))} <= TIMES
