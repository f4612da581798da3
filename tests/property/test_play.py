"""Play operators: every build does what the NumPy twin does, to the last bit, and both do what the law says."""

from __future__ import annotations

import numpy as np
import pytest

from armid import kernel
from armid.model.hysteresis_memory import Play
from armid.model.torque_law_expression import evaluate
from memories import dragged, known_from
from problems import COMPILED, TWIN


def a_walk(rng: np.random.Generator, samples: int, across: int) -> np.ndarray:
    return np.cumsum(0.05 * rng.normal(size=(samples, across)), axis=0) + rng.normal(size=across)


@pytest.mark.parametrize("seed", range(40))
def test_every_build_is_the_twin(seed: int):
    """Fewer nodes than a register holds, a whole register, and more; runs that end before anything is known."""
    rng = np.random.default_rng(seed)
    nodes, samples = 1 + seed % 19, (0, 1, 2, 37, 400)[seed % 5]
    x = a_walk(rng, samples, 4)
    column, width = rng.integers(0, 4, nodes), 10.0 ** rng.uniform(-4.0, 0.5, nodes)
    states, known = kernel.play(x, column, width, chosen=TWIN)
    for build in COMPILED:
        found = kernel.play(x, column, width, chosen=build)
        assert np.array_equal(found[0], states) and np.array_equal(found[1], known)


@pytest.mark.parametrize("build", kernel.instruction_sets())
def test_from_where_it_is_known_the_past_is_forgotten(build: str):
    rng = np.random.default_rng(1)
    x, widths = a_walk(rng, 500, 3), np.array([1e-3, 0.02, 0.1, 0.4, 50.0])
    column = np.array([0, 2, 2, 1, 0])
    states, known = kernel.play(x, column, widths, chosen=build)
    for state, since, c, r in zip(states.T, known, column, widths, strict=True):
        assert since == known_from(x[:, c], r)
        for start in x[0, c] + r * np.array([-1.0, -0.3, 0.0, 0.7, 1.0]):
            assert np.array_equal(dragged(x[:, c], r, start)[since:], state[since:])
        assert (np.abs(state - x[:, c]) <= r * (1.0 + 1e-12)).all()
        low, high = (dragged(x[:, c], r, x[0, c] + side * r)[:since] for side in (-1.0, 1.0))
        assert (low < high).all() and np.array_equal(state[:since], 0.5 * (low + high))
    assert 0 < known[0] < known[2] < 500 and known[-1] == 500


def test_the_kernel_does_what_the_law_states():
    """`Play.update`, from which formulas and code are made, is what the kernel computes."""
    x = a_walk(np.random.default_rng(2), 300, 1)
    play = Play(0.1)
    states, known = kernel.play(x, [0], [play.width])
    since = int(known[0])
    assert since < 200
    for before, q, after in zip(states[since:-1, 0], x[since + 1 :, 0], states[since + 1 :, 0], strict=True):
        assert evaluate(play.update, {"state": before, "q": q}) == after


@pytest.mark.parametrize("build", kernel.instruction_sets())
def test_a_coordinate_that_rests_tells_nothing(build: str):
    states, known = kernel.play(np.full((50, 1), 0.3), [0, 0], [0.1, 1e-9], chosen=build)
    assert known.tolist() == [50, 50]
    assert states == pytest.approx(np.full((50, 2), 0.3), abs=1e-15)


@pytest.mark.parametrize("build", COMPILED)
def test_what_does_not_fit_is_refused(build: str):
    x = np.zeros((5, 2))
    for column, width, message in (([2], [0.1], "follows"), ([-1], [0.1], "follows"), ([0], [0.1, 0.2], "one entry")):
        with pytest.raises(ValueError, match=message):
            kernel.play(x, column, width, chosen=build)
