"""Scenarios by name and from files: what a file changes, and what is refused and how."""

import numpy as np
import pytest

from explore_bench.errors import RequestError
from explore_bench.world.landmark.constants import LandmarkScenario
from explore_bench.world.maps import gallery
from explore_bench.world.scenarios import CHEN_2020, PAPER, SCENARIOS, load_scenario


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


@pytest.mark.parametrize("text", ["", "size = 30.0\n", 'extends = "chen2020"\n', 'map = "loop"\n'])
def test_a_file_without_a_kind_is_of_the_landmarks_and_the_same_as_one_with_it(toml, text):
    scenario = load_scenario(toml(text))
    assert type(scenario) is LandmarkScenario
    assert load_scenario(toml(f'kind = "landmark"\n{text}')) == scenario


def test_a_file_of_an_unknown_kind_is_refused_by_its_name_with_the_nearest(toml):
    path = toml('kind = "landmarks"\n')
    with pytest.raises(RequestError, match=r"'landmarks' is unknown; did you mean 'landmark'\?") as error:
        load_scenario(path)
    assert str(error.value).startswith(f"scenario file '{path}'")
    assert_one_sentence(error)


def test_a_file_may_extend_a_named_scenario(toml):
    scenario = load_scenario(toml('extends = "chen2020"\ncoverage = 0.5\n'))
    assert scenario == CHEN_2020.replace(coverage=0.5)


@pytest.mark.parametrize(
    ("text", "named"),
    [
        ("size = = 20", "it is not TOML"),
        ("size = 20\nsize = 30\n", "it is not TOML"),
        ('{"size": 20}', "it is not TOML"),
        ("strategy,size\nrandom,20\n", "it is not TOML"),
        (b"\x89PNG\r\n\x1a\n\x00\xff\xfe", "not UTF-8 text"),
        ("sise = 20", "did you mean 'size'"),
        ("[scenario]\nsize = 20\n", "'scenario'"),
        ("size = -1", "'size' is -1"),
        ("size = [20]", "'size' is [20]"),
        ('extends = "chen2021"', "did you mean 'chen2020'"),
        ("extends = 3", "extends '3'"),
        ('extends = ["paper"]', "extends"),
        ("extends = {name = 'paper'}", "extends"),
        ("self = 1", "'self'"),
        ("kind = 3", "kind of world '3'"),
        ('kind = ["landmark"]', "kind of world"),
        ('extends = "paper"\nkind = "sea"', "'kind' is 'sea'"),
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
    with pytest.raises(RequestError, match=r"folder\.toml.*no regular file"):
        load_scenario(str(tmp_path / "folder.toml"))


def test_a_file_of_another_kind_is_refused_by_name(toml):
    with pytest.raises(RequestError, match=r"mine\.json"):
        load_scenario(toml("{}", "mine.json"))


# Maps

ROWS = ("####", "#S.#", "#..#", "####")


def test_a_file_may_draw_a_map_itself(toml):
    scenario = load_scenario(toml('occlusion = true\nmap = ["####", "#S.#", "#..#", "####"]\n'))
    assert scenario == PAPER.replace(map=ROWS, occlusion=True)


def test_a_file_may_name_a_map_that_lies_beside_it_whatever_the_working_folder(toml, tmp_path, monkeypatch):
    (tmp_path / "maps").mkdir()
    (tmp_path / "maps" / "rooms.txt").write_text("\n".join(ROWS))
    path = toml('extends = "chen2020"\nmap = "maps/rooms.txt"\ncell_size = 1.0\nplanner = "grid"\n')
    monkeypatch.chdir(tmp_path / "maps")
    assert load_scenario(path) == CHEN_2020.replace(map=ROWS, cell_size=1.0, planner="grid")


def test_a_file_says_how_wide_a_pixel_is(toml, tmp_path):
    np.save(tmp_path / "rooms.npy", np.kron([[one == "#" for one in row] for row in ROWS], np.ones((4, 4))) > 0)
    scenario = load_scenario(toml('map = "rooms.npy"\nresolution = 0.5\n'))
    assert scenario.map == tuple(row.replace("S", ".") for row in ROWS)
    assert load_scenario(toml('map = "rooms.npy"\nresolution = 2\n')).size == 32.0


def test_a_file_may_name_a_map_of_the_gallery(toml):
    assert load_scenario(toml('map = "loop"\n')).map == gallery()["loop"]


@pytest.mark.parametrize(
    ("text", "named"),
    [
        ('map = "gone.yaml"', "gone.yaml': it cannot be read (No such file or directory)"),
        ('map = "lop"', "nor one of the gallery (cave, corridor, loop, rooms)"),
        ("map = []", "the map is empty"),
        ("map = 3", "'map' is 3"),
        ('map = ["..", "#x"]', "row 2 of the map holds 'x'"),
        ('map = "loop"\nresolution = "fine"', "'resolution' is 'fine'"),
        ('map = "loop"\nresolution = true', "'resolution' is True"),
        ('map = "loop"\nsize = 20.0', "size 20 m is not that of the map, 40 m; leave it out"),
        ('map = ["...."]\nsize = 20.0', "size 20 m is not that of the map, 8 m; leave it out"),
        ("resolution = 0.05", "'resolution'"),
        ('map = "loop"\ncell_size = -1', "'cell_size' is -1"),
    ],
)
def test_a_wrong_map_is_refused_by_the_file_and_what_is_wrong(toml, text, named):
    path = toml(text)
    with pytest.raises(RequestError) as error:
        load_scenario(path)
    assert str(error.value).startswith(f"scenario file '{path}'")
    assert named in str(error.value)
    assert_one_sentence(error)
