"""Clearances against scipy's distance transform, cheapest ways against scipy's Dijkstra, and lines of sight."""

import math

import numpy as np
import pytest
from scipy import ndimage
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import dijkstra

from explore_bench.geometry import Grid
from explore_bench.robot.lidar.terrain import (
    SOFT_GAIN,
    SOFT_RADIUS,
    Terrain,
    clearance_of,
    in_sight,
    length_of,
    spread,
)

SQRT2 = math.sqrt(2.0)


def blobs(seed, shape=(40, 50), share=0.02, thick=3):
    """Cells in blocks as well as alone, so that some lie within others."""
    rng = np.random.default_rng(seed)
    return ndimage.binary_dilation(rng.random(shape) < share, iterations=thick) | (rng.random(shape) < share)


@pytest.mark.parametrize("most", [0.6, 1.0, 3.7])
@pytest.mark.parametrize("thick", [1, 4])
@pytest.mark.parametrize("seed", range(3))
def test_clearance_is_the_capped_distance_to_the_nearest_occupied_cell(seed, thick, most):
    occupied = blobs(seed, share=0.004, thick=thick)
    expected = np.minimum(ndimage.distance_transform_edt(~occupied) * 0.2, most)
    assert (expected == most).any() or most > 3.0
    np.testing.assert_allclose(clearance_of(occupied, 0.2, most), expected, atol=1e-12)


def test_where_all_is_occupied_or_nothing_clearance_is_nothing_or_the_most():
    assert not clearance_of(np.ones((5, 6), dtype=bool), 0.1, 0.6).any()
    np.testing.assert_allclose(clearance_of(np.zeros((5, 6), dtype=bool), 0.1, 0.6), 0.6)


def test_free_cells_are_known_and_clear():
    known, occupied = np.ones((20, 20), dtype=bool), np.zeros((20, 20), dtype=bool)
    known[:, 15:], occupied[:, 0] = False, True
    free = Terrain(Grid(20, 20, 0.1), known, occupied).free(0.31)
    assert (free == np.repeat([(np.arange(20) >= 4) & (np.arange(20) < 15)], 20, axis=0)).all()


def edges_of(free, price):
    """Steps to the eight neighbours that are free, none of which cuts a corner, and what they cost."""
    rows, columns = free.shape
    found = {}
    for cell in range(free.size):
        row, column = divmod(cell, columns)
        for i, j in ((a, b) for a in (-1, 0, 1) for b in (-1, 0, 1) if a or b):
            to = row + i, column + j
            if not (0 <= to[0] < rows and 0 <= to[1] < columns and free[to]):
                continue
            if i and j and not (free[row + i, column] and free[row, column + j]):
                continue
            cost = 0.5 * (SQRT2 if i and j else 1.0) * (price[row, column] + price[to])
            found[cell, to[0] * columns + to[1]] = cost
    return found


@pytest.mark.parametrize("seed", range(12))
def test_ways_are_as_cheap_as_dijkstra_s(seed):
    """On small grids of any prices, 1 to 4 or 0.1 to 3, the start free or not."""
    rng = np.random.default_rng(seed)
    shape = (int(rng.integers(5, 14)), int(rng.integers(5, 14)))
    free = rng.random(shape) > rng.choice([0.1, 0.3, 0.45])
    price = rng.uniform(*((1.0, 4.0) if seed % 2 else (0.1, 3.0)), shape)
    start = int(rng.integers(free.size))
    edges = edges_of(free, price)
    (one, other), cost = np.array(list(edges)).T, list(edges.values())
    expected = dijkstra(csr_matrix((cost, (one, other)), shape=(free.size, free.size)), indices=start)
    found, parent = spread(free, price, start)
    np.testing.assert_allclose(found, expected, atol=1e-9)
    for cell in np.flatnonzero(np.isfinite(found)):
        total, at = 0.0, int(cell)
        while at != start:
            total += edges[int(parent[at]), at]
            at = int(parent[at])
        assert total == pytest.approx(found[cell]), "the way that is traced costs what is claimed"
    assert (parent[~np.isfinite(found)] == -1).all()


def test_no_way_cuts_a_corner():
    free = np.array([[1, 0], [1, 1]], dtype=bool)
    cost, _ = spread(free, np.ones((2, 2)), 0)
    assert cost.tolist() == [0.0, math.inf, 1.0, 2.0]


def terrain_with_gaps():
    """A room of 4 m with a wall across, with a gap of 1.9 m on the left and one of 0.9 m straight ahead."""
    occupied = np.zeros((40, 40), dtype=bool)
    occupied[20, 19:23] = occupied[20, 32:] = True
    occupied[0] = occupied[-1] = occupied[:, 0] = occupied[:, -1] = True
    return Terrain(Grid(40, 40, 0.1), np.ones((40, 40), dtype=bool), occupied)


def test_a_way_costs_more_near_walls():
    """Far from all walls its length, and at a clearance c as many times more as is said."""
    size = 60
    occupied = np.zeros((size, size), dtype=bool)
    occupied[0] = True
    terrain = Terrain(Grid(size, size, 0.1), np.ones((size, size), dtype=bool), occupied)
    ways = terrain.ways(30 * size + 5, 0.1)
    assert ways.cost[30 * size + 25] == pytest.approx(2.0)
    beside = terrain.ways(3 * size + 5, 0.1)
    assert beside.cost[3 * size + 6] == pytest.approx(0.1 * (1.0 + SOFT_GAIN * (1.0 - 0.3 / SOFT_RADIUS)))
    assert terrain.clearance[3, 5] == pytest.approx(0.3)


def test_ways_keep_their_clearance_all_the_way_but_at_the_start():
    terrain = terrain_with_gaps()
    start = 1 * 40 + 20  # touches the wall below
    ways = terrain.ways(start, 0.31)
    assert ways.start == start
    assert ways.cost[start] == 0.0
    goal = 33 * 40 + 20
    assert not math.isfinite(ways.cost[goal]), "from where it stands the robot cannot leave at once"
    ways = terrain.ways(10 * 40 + 20, 0.31)
    path = ways.to(goal)
    assert path[0] == 10 * 40 + 20
    assert path[-1] == goal
    assert terrain.clearance.reshape(-1)[path[1:]].min() >= 0.31
    assert (path % 40).min() < 18 or (path % 40).max() > 23, "around the wall"
    np.testing.assert_array_equal(ways.reached, np.isfinite(ways.cost).reshape(40, 40))


def test_a_gap_is_a_way_only_for_what_fits_through():
    """The cells beside a gap of nine cells stand 0.5 m from its middle."""
    occupied = np.zeros((40, 40), dtype=bool)
    occupied[20] = True
    occupied[20, 15:24] = False
    terrain = Terrain(Grid(40, 40, 0.1), np.ones((40, 40), dtype=bool), occupied)
    for radius, open_ in ((0.41, True), (0.5, True), (0.51, False)):
        assert math.isfinite(terrain.ways(10 * 40 + 19, radius).cost[30 * 40 + 19]) == open_


def test_the_length_of_a_path_counts_diagonals():
    path = np.array([0, 1, 12, 22, 33, 32])
    assert length_of(path, 10, 0.1) == pytest.approx(0.1 * (3.0 + 2.0 * SQRT2))
    assert length_of(path[:1], 10, 0.1) == 0.0
    assert length_of(np.array([9, 10]), 20, 0.1) == pytest.approx(0.1)


@pytest.mark.parametrize("seed", range(4))
def test_sight_is_free_of_cells_that_the_line_goes_through_and_else_blocked(seed):
    """Against points along the line: one well inside a blocked cell blocks; where all stay well clear, none does."""
    blocked = np.random.default_rng(seed).random((25, 30)) < 0.04
    rng = np.random.default_rng(50 + seed)
    seen = 0
    for _ in range(300):
        ends = rng.integers((0, 0), (25, 30), (2, 2))
        one, other = (int(row * 30 + column) for row, column in ends)
        t = np.linspace(0.0, 1.0, 2001)[1:-1, None]
        points = ends[0] * (1 - t) + ends[1] * t
        around = [np.floor(points + 0.5 + d).astype(int) for d in ((-0.25, 0), (0.25, 0), (0, -0.25), (0, 0.25))]
        others = np.ones(len(points), dtype=bool)
        for end in ends:
            others &= (np.abs(points - end) > 0.76).any(axis=1)
        hits = [blocked[tuple(np.clip(a, 0, (24, 29)).T)] & others for a in around]
        found = in_sight(blocked, one, other)
        if np.all(hits, axis=0).any():
            assert not found
        touched = ndimage.binary_dilation(blocked, np.ones((3, 3)))
        if not touched[tuple(np.floor(points + 0.5).astype(int).T)].any():
            assert found
        seen += found
    assert 20 < seen < 280


def test_a_wall_hides_what_is_behind_it_from_either_side():
    blocked = np.zeros((20, 20), dtype=bool)
    blocked[:, 10] = True
    blocked[15, 10] = False
    for one, other, sees in ((5 * 20 + 3, 5 * 20 + 9, True), (5 * 20 + 3, 5 * 20 + 12, False), (303, 317, True)):
        assert in_sight(blocked, one, other) is sees
        assert in_sight(blocked, other, one) is sees
