"""Occupancy by hand and by an independent placement, and the entropies against scipy and many digits."""

import decimal
import math
from decimal import Decimal

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from scipy.stats import entropy

from explore_bench.robot.occupancy import (
    OCCUPIED_ABOVE,
    OccupancyMap,
    log_odds_increments,
    point_in_patch,
    probability,
    renyi_entropy,
    shannon_entropy,
)
from explore_bench.world.scenario import Scenario

FREE, OCCUPIED, HIDDEN = 0, 1, 2
ONE_CELL = Scenario(size=4.0, sensor_range=0.5, landmark_count=0, obstacle_count=0)
"""From the centre of its first cell a robot sees only that cell."""


def after(*values, scenario=ONE_CELL):
    """Map after scans of one cell that read these values."""
    occupancy = OccupancyMap(scenario)
    for value in values:
        patch = np.full((1, 3, 3), 1 - min(value, 1), dtype=np.uint8)
        patch[0, 1, 1] = value
        occupancy.place(np.array([[1.0, 1.0, 0.3]]), patch, np.array([[3.0, 3.0, 0.3]]))
    return occupancy


# --- hits and misses -------------------------------------------------------------------------------------


def test_unknown_cells_stay_at_one_half_and_are_not_occupied():
    occupancy = after(OCCUPIED)
    np.testing.assert_array_equal(occupancy.probability[1:], 0.5)
    assert occupancy.known.tolist() == [True, False, False, False]
    assert occupancy.occupied.tolist() == [True, False, False, False]


@pytest.mark.parametrize(
    ("values", "expected"),
    [
        ([OCCUPIED], 0.7),
        ([FREE], 0.3),
        ([OCCUPIED, OCCUPIED], 0.49 / (0.49 + 0.09)),
        ([FREE, FREE], 0.09 / (0.49 + 0.09)),
        ([OCCUPIED, OCCUPIED, FREE], 0.7),
        ([OCCUPIED] * 3, 0.343 / (0.343 + 0.027)),
        ([OCCUPIED] * 4, 0.95),
        ([FREE] * 9, 0.05),
        ([OCCUPIED] * 9, 0.95),
        ([OCCUPIED] * 9 + [FREE], 0.95 * 0.3 / (0.95 * 0.3 + 0.05 * 0.7)),
        ([FREE] * 9 + [OCCUPIED], 0.05 * 0.7 / (0.05 * 0.7 + 0.95 * 0.3)),
    ],
)
def test_probability_after_some_scans_by_bayes_rule(values, expected):
    """Hit 0.7, miss 0.3, clamped to 0.05–0.95 after every scan."""
    occupancy = after(*values)
    assert occupancy.probability[0] == pytest.approx(expected, rel=1e-12)
    assert bool(occupancy.occupied[0]) == (expected > 0.5)


@pytest.mark.parametrize("values", [[OCCUPIED, FREE], [FREE, OCCUPIED], [OCCUPIED, FREE] * 3])
def test_as_many_hits_as_misses_are_even_odds_and_not_occupied(values):
    occupancy = after(*values)
    assert occupancy.probability[0] == pytest.approx(0.5, abs=1e-15)
    assert occupancy.probability[0] < OCCUPIED_ABOVE
    assert not occupancy.occupied.any()
    assert occupancy.known[0]


def test_a_cell_whose_centre_lies_exactly_at_the_range_is_seen():
    """From the centre of a cell of 2 m, 2 m to the four sides; those at the corners are 2.8 m away."""
    occupancy = OccupancyMap(Scenario(size=10.0, sensor_range=2.0))
    occupancy.place(np.array([[5.0, 5.0, 0.0]]), np.zeros((1, 3, 3), dtype=np.uint8), np.array([[3.0, 3.0, 0.0]]))
    assert np.flatnonzero(occupancy.known).tolist() == [7, 11, 12, 13, 17]


def test_hidden_cells_stay_unknown():
    occupancy = after(HIDDEN)
    assert not occupancy.known.any()
    np.testing.assert_array_equal(occupancy.probability, 0.5)
    assert after(HIDDEN, OCCUPIED).probability[0] == pytest.approx(0.7)


def test_the_sensor_model_is_the_scenarios():
    scenario = ONE_CELL.replace(hit=0.8, miss=0.4, occupancy_clamp=0.1)
    assert after(OCCUPIED, scenario=scenario).probability[0] == pytest.approx(0.8)
    assert after(FREE, scenario=scenario).probability[0] == pytest.approx(0.4)
    assert after(*[OCCUPIED] * 5, scenario=scenario).probability[0] == pytest.approx(0.9)
    assert log_odds_increments(scenario) == pytest.approx((math.log(4.0), math.log(2 / 3), math.log(9.0)))


def test_probability_of_log_odds():
    np.testing.assert_allclose(probability(np.log([1.0, 3.0, 1 / 3])), [0.5, 0.75, 0.25], rtol=1e-15)


def test_clear_forgets():
    occupancy = after(OCCUPIED, OCCUPIED)
    occupancy.clear()
    assert not occupancy.known.any()
    np.testing.assert_array_equal(occupancy.probability, 0.5)


# --- placing ---------------------------------------------------------------------------------------------


def obstacle_two_cells_east(heading=0.0):
    """Scan from the middle of a patch whose only obstacle is two cells along its x axis."""
    patch = np.zeros((1, 7, 7), dtype=np.uint8)
    patch[0, 3, 5] = OCCUPIED
    return patch, np.array([[7.0, 7.0, heading]])


@pytest.mark.parametrize(
    ("pose", "heading", "cell"),
    [
        ((9.0, 9.0, 0.0), 0.0, (4, 6)),  # where it is
        ((9.0, 9.0, 0.8), 0.8, (4, 6)),  # the true heading is no matter when it is known
        ((11.0, 9.0, 0.0), 0.0, (4, 7)),  # believed one cell to the east
        ((9.9, 9.0, 0.0), 0.0, (4, 6)),  # off by less than half a cell
        ((10.1, 9.0, 0.0), 0.0, (4, 7)),  # and by more
        ((9.0, 13.0, 0.0), 0.0, (6, 6)),  # two cells to the north
        ((9.0, 9.0, math.pi / 2), 0.0, (6, 4)),  # believed turned left by 90°
        ((9.0, 9.0, 0.8 - math.pi / 2), 0.8, (2, 4)),  # and right
        ((9.0, 9.0, 0.8 + math.pi), 0.8, (4, 2)),
    ],
)
def test_a_displaced_estimate_displaces_what_is_seen(pose, heading, cell):
    occupancy = OccupancyMap(Scenario())
    occupancy.place(np.array([pose]), *obstacle_two_cells_east(heading))
    assert [divmod(int(c), 10) for c in np.flatnonzero(occupancy.occupied)] == [cell]


def test_what_is_placed_outside_the_map_is_dropped():
    occupancy = OccupancyMap(Scenario())
    occupancy.place(np.array([[17.0, 9.0, 0.0]]), *obstacle_two_cells_east())
    assert not occupancy.occupied.any()
    assert occupancy.known.any()


def placed_by_numpy(scenario, poses, patches, origins):
    """Log odds and knowledge by whole-grid arithmetic with rotation matrices."""
    row, column = np.divmod(np.arange(scenario.cell_count), scenario.grid.columns)
    centres = (np.column_stack((column, row)) + 0.5) * scenario.cell_size
    log_odds, known = np.zeros(scenario.cell_count), np.zeros(scenario.cell_count, dtype=bool)
    for (x, y, estimated), patch, (u, v, true) in zip(poses, patches, origins, strict=True):
        offset = centres - (x, y)
        c, s = math.cos(estimated), math.sin(estimated)
        of_robot = offset @ np.array([[c, -s], [s, c]])  # R(estimated)ᵀ offset
        c, s = math.cos(true), math.sin(true)
        point = (u, v) + of_robot @ np.array([[c, s], [-s, c]])  # origin + R(true) q
        index = np.clip(np.floor(point / scenario.cell_size).astype(int), 0, len(patch) - 1)
        value = patch[index[:, 1], index[:, 0]]
        seen = (np.hypot(*offset.T) <= scenario.sensor_range) & (value != HIDDEN)
        known |= seen
        change = np.where(value == OCCUPIED, math.log(7 / 3), math.log(3 / 7))
        log_odds[seen] = np.clip(log_odds + change, -math.log(19), math.log(19))[seen]
    return log_odds, known


def random_scans(seed, count):
    rng = np.random.default_rng(seed)
    poses = rng.uniform((-2.0, -2.0, -np.pi), (22.0, 22.0, np.pi), (count, 3))
    patches = rng.choice(np.array([FREE, OCCUPIED, HIDDEN], dtype=np.uint8), (count, 7, 7), p=[0.5, 0.3, 0.2])
    origins = rng.uniform((6.0, 6.0, -np.pi), (8.0, 8.0, np.pi), (count, 3))
    return poses, patches, origins


@settings(max_examples=60, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), count=st.integers(1, 20))
def test_every_cell_in_range_takes_the_value_at_its_point_of_the_scan(seed, count):
    scans = random_scans(seed, count)
    occupancy = OccupancyMap(Scenario())
    occupancy.place(*scans)
    log_odds, known = placed_by_numpy(Scenario(), *scans)
    np.testing.assert_array_equal(occupancy.known, known)
    np.testing.assert_allclose(occupancy.probability, probability(log_odds), atol=1e-12)
    np.testing.assert_array_equal(occupancy.occupied, log_odds > 1e-8)


@pytest.mark.parametrize("cut", [1, 8, 29])
def test_placing_in_two_calls_equals_placing_in_one(cut):
    scans = random_scans(1, 30)
    whole, parts = OccupancyMap(Scenario()), OccupancyMap(Scenario())
    whole.place(*scans)
    parts.place(*(part[:cut] for part in scans))
    parts.place(*(part[cut:] for part in scans))
    np.testing.assert_array_equal(parts.probability, whole.probability)
    np.testing.assert_array_equal(parts.known, whole.known)


def test_point_in_patch_by_hand():
    """Two metres ahead of a robot that believes it looks north, and truly looked along the patch's −x axis."""
    point = point_in_patch(0.0, 2.0, math.pi / 2, np.array([7.5, 6.5, math.pi]))
    assert point == pytest.approx((5.5, 6.5))


# --- entropies -------------------------------------------------------------------------------------------

PROBABILITIES = st.floats(1e-9, 1.0 - 1e-9)
ORDERS = st.floats(0.05, 60.0)


def exact_renyi(p, beta):
    """Eq. 6 with fifty digits."""
    with decimal.localcontext(prec=50):
        p, beta = Decimal(p), Decimal(beta)
        powers = (p.ln() * beta).exp() + ((1 - p).ln() * beta).exp()
        return float(powers.ln() / Decimal(2).ln() / (1 - beta))


@given(p=st.floats(0.0, 1.0))
def test_shannon_entropy_is_scipys(p):
    assert float(shannon_entropy(p)) == pytest.approx(entropy([p, 1.0 - p], base=2), abs=1e-15, rel=1e-12)


def test_shannon_entropy_by_hand():
    found = shannon_entropy([[0.0, 1.0], [0.5, 0.25]])
    np.testing.assert_allclose(found, [[0.0, 0.0], [1.0, 2.0 - 0.75 * math.log2(3.0)]], rtol=1e-15)


@settings(max_examples=200)
@given(p=st.floats(0.001, 0.999), beta=ORDERS.filter(lambda b: abs(b - 1.0) > 1e-3))
def test_renyi_entropy_is_its_formula_with_many_digits(p, beta):
    assert float(renyi_entropy(p, beta)) == pytest.approx(exact_renyi(p, beta), rel=1e-9, abs=1e-12)


@pytest.mark.parametrize("p", [1e-12, 1e-20, 1e-300])
@pytest.mark.parametrize("beta", [0.01, 0.1])
def test_renyi_entropy_of_a_tiny_probability_keeps_its_digits(p, beta):
    """At small orders even 1e-20 counts: H₀.₀₁ = 0.7 bit."""
    assert float(renyi_entropy(p, beta)) == pytest.approx(exact_renyi(p, beta), rel=1e-9)


def test_renyi_entropy_by_hand():
    """β = 2: −log₂(p² + q²); β = 0: both outcomes are possible; β = ½: 2 log₂(√p + √q)."""
    assert float(renyi_entropy(0.25, 2.0)) == pytest.approx(-math.log2(0.625))
    assert float(renyi_entropy(0.25, 0.0)) == pytest.approx(1.0)
    assert float(renyi_entropy(0.25, 0.5)) == pytest.approx(2.0 * math.log2(0.5 + math.sqrt(0.75)))


@given(p=st.floats(0.0, 1.0))
def test_renyi_entropy_of_order_one_is_shannons(p):
    assert float(renyi_entropy(p, 1.0)) == float(shannon_entropy(p))


@given(p=PROBABILITIES, exponent=st.floats(-15.0, -4.0), sign=st.sampled_from([-1.0, 1.0]))
def test_renyi_entropy_is_continuous_at_order_one(p, exponent, sign):
    """|dH/dβ| stays below 1 bit near β = 1."""
    distance = 10.0**exponent
    assert float(renyi_entropy(p, 1.0 + sign * distance)) == pytest.approx(
        float(shannon_entropy(p)), abs=distance + 1e-9
    )


@given(p=st.floats(0.0, 1.0))
def test_renyi_entropy_of_infinite_order_is_the_min_entropy(p):
    expected = -math.log2(max(p, 1.0 - p))
    assert float(renyi_entropy(p, math.inf)) == pytest.approx(expected, abs=1e-15)
    assert float(renyi_entropy(p, 1e9)) == pytest.approx(expected, abs=1e-8)


@settings(max_examples=200)
@given(p=PROBABILITIES, orders=st.tuples(st.floats(0.0, 100.0), st.floats(0.0, 100.0)))
def test_renyi_entropy_never_rises_with_its_order(p, orders):
    low, high = sorted(orders)
    assert float(renyi_entropy(p, high)) <= float(renyi_entropy(p, low)) + 1e-9


@given(p=st.floats(0.01, 0.99), beta=ORDERS)
def test_entropies_do_not_tell_occupied_from_free(p, beta):
    assert float(shannon_entropy(p)) == pytest.approx(float(shannon_entropy(1.0 - p)), rel=1e-12)
    assert float(renyi_entropy(p, beta)) == pytest.approx(float(renyi_entropy(1.0 - p, beta)), rel=1e-9)


@pytest.mark.parametrize("beta", [0.0, 0.3, 1.0, 2.0, 1e6, math.inf])
def test_a_certain_cell_has_no_entropy_and_an_even_one_a_bit(beta):
    assert renyi_entropy([0.0, 1.0, 0.5], beta).tolist() == pytest.approx([0.0, 0.0, 1.0], abs=1e-12)


def test_renyi_entropy_broadcasts_its_order():
    p, beta = np.array([0.2, 0.4]), np.array([[0.5], [1.0], [math.inf]])
    found = renyi_entropy(p, beta)
    assert found.shape == (3, 2)
    for i in range(3):
        for j in range(2):
            assert found[i, j] == float(renyi_entropy(p[j], beta[i, 0]))
