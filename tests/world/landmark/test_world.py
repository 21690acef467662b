"""Worlds at random: counts, places, connectedness, repeatability, and what tells them apart."""

from collections import deque

import numpy as np
import pytest
from handmade import HALLS
from scipy import stats

from explore_bench.errors import RequestError
from explore_bench.geometry import Grid, cell_of, centre_of
from explore_bench.trial.seeding import stream
from explore_bench.world.floor_plan import floor_plan
from explore_bench.world.kinds import draw_world
from explore_bench.world.landmark.world import LandmarkWorld
from explore_bench.world.scenario import Scenario

SIZES = (20.0, 30.0, 40.0)


def world_of(trial, size=20.0, **changes):
    return draw_world(Scenario(size=size, **changes), stream("evaluate", 0, size, trial, "world"))


def landmark_cells(world):
    return [cell_of(world.grid, x, y) for x, y in world.landmarks.tolist()]


def start_cell(world):
    return cell_of(world.grid, *world.start[:2])


def reachable(free, start):
    """Cells reached from one by steps to the four sides, found by breadth-first search."""
    n = len(free)
    seen, queue = {start}, deque([start])
    while queue:
        row, column = divmod(queue.popleft(), n)
        for r, c in ((row - 1, column), (row + 1, column), (row, column - 1), (row, column + 1)):
            if 0 <= r < n and 0 <= c < n and free[r, c] and r * n + c not in seen:
                seen.add(r * n + c)
                queue.append(r * n + c)
    return seen


def test_one_stream_gives_one_world():
    first, second = world_of(7), world_of(7)
    assert np.array_equal(first.obstacles, second.obstacles)
    assert np.array_equal(first.landmarks, second.landmarks)
    assert first.start == second.start
    assert first.digest == second.digest


def test_the_trials_of_a_size_meet_different_worlds():
    assert len({world_of(trial).digest for trial in range(100)}) == 100


@pytest.mark.parametrize("size", SIZES)
def test_counts_are_those_of_the_scenario(size):
    scenario = Scenario(size=size)
    world = world_of(0, size)
    assert world.grid == scenario.grid == Grid(int(size / 2), int(size / 2), 2.0)
    assert np.count_nonzero(world.obstacles) == scenario.obstacles
    assert world.landmarks.shape == (scenario.landmarks, 2)


def test_a_world_may_be_empty():
    world = world_of(0, landmark_count=0, obstacle_count=0)
    assert world.landmarks.shape == (0, 2)
    assert not world.obstacles.any()


@pytest.mark.parametrize("size", SIZES)
def test_landmarks_lie_in_distinct_free_cells_and_not_at_the_start(size):
    for trial in range(30):
        world = world_of(trial, size)
        cells = landmark_cells(world)
        assert len(set(cells)) == len(cells)
        assert not world.obstacles.reshape(-1)[cells].any()
        assert start_cell(world) not in cells


@pytest.mark.parametrize(("size", "density"), [(20.0, 1.5), (20.0, 3.5), (40.0, 1.5)])
def test_every_free_cell_is_reachable_from_the_start(size, density):
    """Cells of obstacles and of landmarks are blocked; all others are joined."""
    for trial in range(30):
        world = world_of(trial, size, obstacle_density=density)
        free = ~world.obstacles
        free.reshape(-1)[landmark_cells(world)] = False
        assert len(reachable(free, start_cell(world))) == np.count_nonzero(free)


def test_the_start_is_the_centre_of_a_free_cell():
    for trial in range(30):
        world = world_of(trial)
        cell = start_cell(world)
        assert world.start[:2] == centre_of(world.grid, cell)
        assert not world.obstacles.reshape(-1)[cell]
        assert -np.pi <= world.start[2] <= np.pi


def test_places_and_headings_are_uniform():
    """Kolmogorov–Smirnov over 300 worlds: landmarks inside their cells, headings, cells of start and landmarks."""
    worlds = [world_of(trial) for trial in range(300)]
    inside = np.concatenate([world.landmarks / 2.0 % 1.0 for world in worlds])
    headings = [(world.start[2] + np.pi) / (2 * np.pi) for world in worlds]
    rows = np.array([divmod(start_cell(world), 10) for world in worlds])
    fields = np.concatenate([world.landmarks for world in worlds]) / 20.0
    for sample in (*inside.T, headings, *fields.T):
        assert stats.kstest(sample, "uniform").pvalue > 1e-3
    for sample in rows.T:
        assert stats.chisquare(np.bincount(sample, minlength=10)).pvalue > 1e-3


def test_an_impossible_density_is_refused_in_one_sentence(monkeypatch):
    monkeypatch.setattr("explore_bench.world.landmark.world.MAX_DRAWS", 1000)
    with pytest.raises(
        RequestError, match=r"90 obstacles and 3 landmarks.*10 × 10 cells.*1,000 draws.*obstacle_density"
    ) as error:
        world_of(0, obstacle_density=9.0)
    assert "\n" not in str(error.value)


def test_the_arrays_are_read_only():
    world = world_of(0)
    with pytest.raises(ValueError, match="read-only"):
        world.obstacles[0, 0] = True
    with pytest.raises(ValueError, match="read-only"):
        world.landmarks[0, 0] = 0.0


def simple_world(edge=3, obstacle=4, landmark=(1.0, 1.0), start=(3.0, 1.0, 0.5), cell_size=2.0):
    obstacles = np.zeros(edge * edge, dtype=bool)
    if obstacle is not None:
        obstacles[obstacle] = True
    grid = Grid(edge, edge, cell_size)
    return LandmarkWorld(grid, obstacles.reshape(edge, edge), np.array([landmark]), start)


def test_equal_worlds_have_equal_digests_of_twelve_hexadecimal_digits():
    assert simple_world().digest == simple_world().digest
    assert len(simple_world().digest) == 12
    assert int(simple_world().digest, 16) >= 0


@pytest.mark.parametrize(
    "change",
    [{"obstacle": 5}, {"obstacle": None}, {"landmark": (1.0, 1.0 + 1e-12)}, {"start": (3.0, 1.0, 0.6)}]
    + [{"start": (1.0, 3.0, 0.5)}, {"cell_size": 1.0}, {"edge": 5}],
)
def test_whatever_differs_changes_the_digest(change):
    assert simple_world(**change).digest != simple_world().digest


def test_empty_worlds_of_different_edges_have_different_digests():
    digests = {simple_world(edge=edge, obstacle=None).digest for edge in range(2, 30)}
    assert len(digests) == 28


@pytest.mark.parametrize(
    ("obstacles", "landmarks", "named"),
    [
        ((3, 4), (1, 2), r"\(3, 4\).*grid \(3, 3\)"),
        ((9,), (1, 2), r"\(9,\).*grid \(3, 3\)"),
        ((3, 3), (4,), r"\(M, 2\).*\(4,\)"),
    ],
)
def test_arrays_of_wrong_shapes_are_refused(obstacles, landmarks, named):
    with pytest.raises(ValueError, match=named):
        LandmarkWorld(Grid(3, 3, 2.0), np.zeros(obstacles, dtype=bool), np.zeros(landmarks), (1.0, 1.0, 0.0))


# Given maps


def given(trial, rows=HALLS, **changes):
    return draw_world(Scenario(map=rows, **changes), stream("evaluate", 0, 20.0, trial, "world"))


def test_a_world_of_a_map_is_that_map_and_the_same_for_one_stream():
    world, plan = given(3), floor_plan(HALLS)
    assert np.array_equal(world.obstacles, plan.blocked)
    assert np.array_equal(world.counted, plan.counted)
    assert np.array_equal(world.uncounted, np.flatnonzero(~plan.counted))
    assert world.digest == given(3).digest
    assert len({given(trial).digest for trial in range(50)}) == 50


def test_all_cells_of_a_drawn_world_count():
    assert world_of(0).counted.all()
    assert world_of(0).uncounted.size == 0


def test_what_counts_tells_worlds_apart():
    world = simple_world()
    other = LandmarkWorld(world.grid, world.obstacles, world.landmarks, world.start, np.array([8]))
    assert other.digest != world.digest
    with pytest.raises(ValueError, match="read-only"):
        other.uncounted[0] = 1


@pytest.mark.parametrize("rows", [HALLS, tuple(row.replace("S", ".") for row in HALLS)], ids=["start", "no start"])
def test_landmarks_lie_beside_walls_in_distinct_cells_and_leave_the_rest_joined(rows):
    plan = floor_plan(rows)
    for trial in range(40):
        world = given(trial, rows, landmark_count=12)
        cells = landmark_cells(world)
        assert len(set(cells)) == len(cells) == 12
        assert plan.beside_walls.reshape(-1)[cells].all()
        assert start_cell(world) not in cells
        free = plan.reachable.copy()
        free.reshape(-1)[cells] = False
        assert len(reachable(free, start_cell(world))) == np.count_nonzero(free)


def test_a_passage_of_one_cell_stays_open():
    """In a corridor each landmark is in the last open cell of the far end, whatever the order in which cells come."""
    found = set()
    for trial in range(30):
        world = given(trial, ("#######", "#S....#", "#######"), landmark_count=5)
        columns = sorted(cell % 7 for cell in landmark_cells(world))
        assert columns == list(range(6 - len(columns), 6))
        found.add(len(columns))
    assert found == {1, 2, 3}


def test_there_are_as_many_landmarks_as_asked_for_or_as_there_is_room_for():
    assert len(given(0, landmark_count=5).landmarks) == 5
    assert given(0, landmark_count=0).landmarks.shape == (0, 2)
    crowded = given(0, landmark_count=1000)
    assert 10 < len(crowded.landmarks) < floor_plan(HALLS).reachable.sum() - 2
    assert len(given(0, ("...", "...", "..."), landmark_count=9).landmarks) <= 7
    assert given(0, ("..",), landmark_count=9, cell_size=10.0).landmarks.shape == (0, 2)


def test_the_start_is_the_map_s_with_a_random_heading():
    worlds = [given(trial) for trial in range(30)]
    assert {world.start[:2] for world in worlds} == {(5.0, 5.0)}
    headings = np.array([world.start[2] for world in worlds])
    assert stats.kstest((headings + np.pi) / (2 * np.pi), "uniform").pvalue > 1e-3


def test_without_a_start_it_is_any_open_cell_of_the_largest_region():
    rows = tuple(row.replace("S", ".") for row in HALLS)
    plan = floor_plan(rows)
    starts = []
    for trial in range(300):
        world = given(trial, rows)
        starts.append(start_cell(world))
        assert world.start[:2] == centre_of(world.grid, starts[-1])
        assert plan.reachable.reshape(-1)[starts[-1]]
        assert starts[-1] not in landmark_cells(world)
    assert len(set(starts)) > 0.9 * plan.reachable.sum()


def test_landmarks_of_a_map_are_uniform_inside_their_cells():
    inside = np.concatenate([given(trial).landmarks / 2.0 % 1.0 for trial in range(150)])
    for sample in inside.T:
        assert stats.kstest(sample, "uniform").pvalue > 1e-3
