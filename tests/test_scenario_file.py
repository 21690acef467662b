"""Scenarios by name and from files: what a file changes, and what is refused and how."""

import pytest

from explore_bench.errors import RequestError
from explore_bench.scenario import CHEN_2020, PAPER, SCENARIOS
from explore_bench.scenario_file import load_scenario


@pytest.fixture
def toml(tmp_path):
    def write(text, name="mine.toml"):
        path = tmp_path / name
        path.write_bytes(text if isinstance(text, bytes) else text.encode())
        return str(path)

    return write


def assert_one_sentence(error):
    message = str(error.value)
    assert "\n" not in message
    assert message.endswith((".", "?"))


def test_every_registered_scenario_is_found_by_name_and_described():
    for name, (scenario, meaning) in SCENARIOS.items():
        assert load_scenario(name) is scenario
        assert meaning


def test_an_unknown_name_is_refused_with_the_near_spelling():
    with pytest.raises(RequestError, match=r"scenario 'papre' is unknown; did you mean 'paper'\?"):
        load_scenario("papre")


def test_a_file_changes_the_paper_s_scenario(toml):
    scenario = load_scenario(toml("size = 30\nocclusion = true\nfusion = 'determinant'\n"))
    assert scenario == PAPER.replace(size=30.0, occlusion=True, fusion="determinant")


def test_an_empty_file_is_the_paper_s_scenario(toml):
    assert load_scenario(toml("# nothing\n")) == PAPER


def test_a_file_may_extend_a_named_scenario(toml):
    scenario = load_scenario(toml('extends = "chen2020"\ncoverage = 0.5\n'))
    assert scenario == CHEN_2020.replace(coverage=0.5)


@pytest.mark.parametrize(
    ("text", "named"),
    [
        ("size = = 20", "is not TOML"),
        ("size = 20\nsize = 30\n", "is not TOML"),
        ('{"size": 20}', "is not TOML"),
        ("strategy,size\nrandom,20\n", "is not TOML"),
        (b"\x89PNG\r\n\x1a\n\x00\xff\xfe", "cannot be read"),
        ("sise = 20", "did you mean 'size'"),
        ("[scenario]\nsize = 20\n", "'scenario'"),
        ("size = -1", "'size' is -1"),
        ("size = [20]", "'size' is [20]"),
        ('extends = "chen2021"', "did you mean 'chen2020'"),
        ("extends = 3", "extends '3'"),
        ('extends = ["paper"]', "extends"),
        ("extends = {name = 'paper'}", "extends"),
        ("self = 1", "'self'"),
    ],
)
def test_a_wrong_file_is_refused_by_its_name_and_what_is_wrong(toml, text, named):
    path = toml(text)
    with pytest.raises(RequestError) as error:
        load_scenario(path)
    assert path in str(error.value)
    assert named in str(error.value)
    assert_one_sentence(error)


def test_a_file_that_is_not_there_is_refused_by_name(tmp_path):
    with pytest.raises(RequestError, match=r"gone\.toml.*No such file"):
        load_scenario(str(tmp_path / "gone.toml"))


def test_a_folder_is_no_scenario_file(tmp_path):
    (tmp_path / "folder.toml").mkdir()
    with pytest.raises(RequestError, match=r"folder\.toml.*cannot be read"):
        load_scenario(str(tmp_path / "folder.toml"))


def test_a_file_of_another_kind_is_refused_by_name(toml):
    with pytest.raises(RequestError, match=r"mine\.json"):
        load_scenario(toml("{}", "mine.json"))
