"""The watch over the global generators: it sees every use, and leaves them as they were."""

import random

import numpy as np
import pytest

from explore_bench.runs.conformance.chance import GLOBAL, watched

torch = pytest.importorskip("torch")

USES = {
    "random": lambda: random.random(),
    "numpy.random": lambda: np.random.rand(),  # noqa: NPY002
    "torch": lambda: float(torch.rand(())),
}


def test_every_generator_is_tried():
    assert list(USES) == [line.split()[0] for line in GLOBAL.strip().splitlines()]


@pytest.mark.parametrize("name", USES)
def test_a_use_is_seen_and_undone(name):
    use = USES[name]
    with watched(0, []):
        first = use()
    used = []
    state = random.getstate(), np.random.get_state()[1].tolist(), torch.get_rng_state().tolist()  # noqa: NPY002
    with watched(0, used):
        assert use() == first, "the state is the number's"
    assert used == [name]
    assert state == (random.getstate(), np.random.get_state()[1].tolist(), torch.get_rng_state().tolist())  # noqa: NPY002


@pytest.mark.parametrize("name", USES)
def test_another_number_is_another_state(name):
    drawn = []
    for number in (0, 1):
        with watched(number, []):
            drawn.append(USES[name]())
    assert drawn[0] != drawn[1]


def test_seeding_anew_is_a_use_and_drawing_from_an_own_generator_is_none():
    used = []
    with watched(0, used):
        np.random.seed(5)  # noqa: NPY002
    assert used == ["numpy.random"]
    used = []
    with watched(0, used):
        np.random.default_rng(3).normal()
        random.Random(3).random()
    assert used == []


def test_states_come_back_where_the_block_raises():
    state = random.getstate()
    used = []
    with pytest.raises(KeyError), watched(0, used):
        random.random()
        raise KeyError
    assert used == ["random"]
    assert random.getstate() == state
