"""Duties of every torque term, on every built-in arm."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import numpy as np
import pytest

from armid.errors import ArmidError
from armid.information import accumulate, filtering
from armid.information.accumulate import accumulate_information
from armid.information.hysteresis_states import with_hysteresis_states
from armid.maths.signals.zero_phase_filters import edge_samples, low_pass
from armid.measurement.low_pass_band import Band
from armid.measurement.observations import Observations
from armid.model.base_parameters import find_base_parameters
from armid.model.dynamics_model import DynamicsModel
from armid.model.motion import Motion
from armid.model.terms import TERMS, Term
from armid.model.torque_law_expression import derivative, evaluate, latex, symbols, text
from armid.robot import Robot, builtin_arms, load_robot
from informed import assert_says, dense, filtered
from memories import joints_known_from, with_any_past
from problems import lively_motion, one_run
from trees import random_inertial, random_tree, robot_of

MADE: dict[str, Callable[[Robot], Term]] = {
    "coupling": lambda robot: TERMS["coupling"](joints=dict(zip(last_two(robot), (1.0, -2.0), strict=True))),
}
"""Makers of terms without defaults; all other terms are made without arguments."""

SHAPED: dict[str, Callable[[Robot], Term]] = {
    "coulomb with a width": lambda robot: TERMS["coulomb"](width=0.05),
    "asymmetric-coulomb with a width": lambda robot: TERMS["asymmetric-coulomb"](width=0.05),
    "stribeck that falls like an exponential": lambda robot: TERMS["stribeck"](velocity=0.3, shape=1.0, width=0.05),
    "power-viscous above one": lambda robot: TERMS["power-viscous"](exponent=1.7),
    "sigmoid without a shift": lambda robot: TERMS["sigmoid"](shift=0.0),
    "piecewise-viscous with one knot": lambda robot: TERMS["piecewise-viscous"](knots=(0.5,)),
    "hysteresis of one element": lambda robot: TERMS["hysteresis"](widths=(0.2,)),
    "ripple of the motor": lambda robot: TERMS["ripple"](harmonics=(), motor_harmonics=(1, 2), gear_ratio=50.0),
    "load-coulomb with a width": lambda robot: TERMS["load-coulomb"](width=0.05),
}
"""Terms whose shapes make another law than the default ones do."""

ARMS = {name: load_robot(name) for name in builtin_arms()}
SYMBOLS = {"q", "dq", "ddq", "load", "state"}

LINEAR = 1e-12
"""Torque and regressor take different ways to the same sum; the terms of the sum are of the order of a hundred."""

SLOPE = 1e-6
"""Central differences with a step of 1e-6 resolve so much of a derivative of the order of one."""

DEPENDENT = 1e-9
"""A regrouped regressor over its largest entry: rounding times coefficients of up to 1e5."""

SETTLED = 1e-7
"""Filtered in batches: the filter has settled to 1e-9 of a jump where batches meet."""

EACH = pytest.mark.parametrize("arm", ARMS)
TERM = pytest.mark.parametrize("name", TERMS)
MADE_TERM = pytest.mark.parametrize("name", [*TERMS, *SHAPED])
OF_JOINTS = [name for name, kind in TERMS.items() if "joints" in {f.name for f in dataclasses.fields(kind)}]
"""Terms that can be restricted to some joints; the others act on the whole arm."""


def last_two(robot: Robot) -> tuple[str, ...]:
    return robot.joint_names[-2:]


def make(name: str, robot: Robot) -> Term:
    special = MADE | SHAPED
    return special[name](robot) if name in special else TERMS[name]()


def motion_of(robot: Robot, samples: int = 40) -> Motion:
    """Random states, two of them at rest."""
    rng = np.random.default_rng(5)
    q, dq, ddq = rng.uniform(-2.0, 2.0, (3, samples, robot.n))
    dq[:2] = 0.0
    return Motion.of_states(q, dq, ddq)


def model_of(robot: Robot, *terms: Term) -> DynamicsModel:
    """A model that knows a load, whatever its terms."""
    return DynamicsModel(robot, terms, random_inertial(np.random.default_rng(7), robot.n))


def bodies_and(term: Term) -> tuple[Term, ...]:
    """Rigid bodies and a term, which may be the same."""
    bodies = TERMS["rigid-body"]()
    return (bodies,) if term == bodies else (bodies, term)


@TERM
def test_is_a_frozen_value(name: str):
    kind = TERMS[name]
    assert kind.name == name
    assert dataclasses.is_dataclass(kind) and kind.__dataclass_params__.frozen and hasattr(kind, "__slots__")
    assert kind.__doc__ and kind.laws.__doc__


@EACH
@MADE_TERM
def test_repr_makes_it_again(name: str, arm: str):
    term = make(name, ARMS[arm])
    again = eval(repr(term), {type(term).__name__: type(term)})  # what a repr is for
    assert again == term and isinstance(term, Term)


@EACH
@MADE_TERM
def test_laws(name: str, arm: str):
    robot = ARMS[arm]
    laws = make(name, robot).laws(robot)
    assert laws == make(name, robot).laws(robot)
    assert len({(law.symbol, law.joint) for law in laws}) == len(laws)
    for law in laws:
        assert law.symbol.isupper() and law.unit
        assert 0 <= law.joint < robot.n and law.joint in dict(law.coordinate)
        assert all(0 <= j < robot.n and weight for j, weight in law.coordinate)
        assert symbols(law.expression) <= SYMBOLS
        assert ("state" in symbols(law.expression)) == (law.memory is not None)
        assert text(law.expression) and latex(law.expression)


@EACH
@MADE_TERM
def test_derivatives_are_slopes(name: str, arm: str):
    """Away from rest, where a sign has none."""
    robot, step = ARMS[arm], 1e-6
    state = {"q": np.array([0.3, -1.1]), "dq": np.array([0.7, -0.2]), "ddq": np.array([1.3, -0.4])}
    state |= {"load": np.array([2.0, -30.0]), "state": np.array([0.301, -1.102])}
    for law in make(name, robot).laws(robot):
        for by in SYMBOLS:
            up, down = ({**state, by: state[by] + h} for h in (step, -step))
            slope = (evaluate(law.expression, up) - evaluate(law.expression, down)) / (2.0 * step)
            exact = evaluate(derivative(law.expression, by), state)
            np.testing.assert_allclose(np.broadcast_to(exact, np.shape(slope)), slope, rtol=0, atol=SLOPE)


@EACH
@MADE_TERM
def test_columns(name: str, arm: str):
    """Finite, the same each time, in the rows that the laws name, and linear in the parameters."""
    robot, motion = ARMS[arm], motion_of(ARMS[arm])
    before = [x.tobytes() for x in (motion.time, motion.q, motion.dq, motion.ddq)]
    model = model_of(robot, make(name, robot))
    Y = model.regressor(motion)
    assert Y.shape == (motion.samples, robot.n, len(model.parameters)) and np.isfinite(Y).all()
    assert Y.tobytes() == model.regressor(motion).tobytes()
    for p, (_, law) in zip(model.law_columns, model.laws, strict=True):
        touched = {int(j) for j in np.flatnonzero(Y[:, :, p].any(axis=0))}
        assert touched == {j for j, _ in law.coordinate}
    theta = np.random.default_rng(6).normal(size=len(model.parameters))
    np.testing.assert_allclose(model.torque(motion, theta), Y @ theta, rtol=0, atol=LINEAR * 100.0)
    assert [x.tobytes() for x in (motion.time, motion.q, motion.dq, motion.ddq)] == before


@MADE_TERM
def test_base_parameters(name: str):
    """With rigid bodies: columns that depend on others are found, whatever the motion has been before."""
    rng = np.random.default_rng(8)
    robot = ARMS["panda"]
    model = model_of(robot, *bodies_and(make(name, robot)))
    base = find_base_parameters(model)
    Y = model.regressor(with_any_past(model, motion_of(robot, 100), rng))
    scale = np.abs(Y).max()
    assert np.abs(Y - Y[:, :, base.kept] @ base.regrouping).max() <= DEPENDENT * scale


@pytest.fixture(scope="module")
def short_arm() -> Robot:
    """Three joints, the first of them sliding."""
    tree = random_tree(np.random.default_rng(3), 3, prismatic=0.0)
    return robot_of(dataclasses.replace(tree, prismatic=[1, 0, 0]))


BANDS = {"open": Band(), "filtered": Band("butterworth", 4.0, 4, "pad"), "periodic": Band("fir", 4.0, 4, "periodic")}


@pytest.mark.parametrize("band", BANDS)
@MADE_TERM
def test_streamed_in_pieces(name: str, band: str, short_arm: Robot, monkeypatch: pytest.MonkeyPatch):
    """The stream makes of a term, chunk by chunk, what dense columns through the same filter are; and rows
    before its memory is known do not count."""
    model = model_of(short_arm, *bodies_and(make(name, short_arm)))
    base = find_base_parameters(model)
    rng = np.random.default_rng(9)
    motion = lively_motion(rng, 3, 200.0, 10.0)
    torque = rng.normal(size=(motion.samples, 3))
    run = one_run(motion, torque, 200.0, step=4, offset=1, block_rows=60)
    for module, sizes in ((accumulate, (97, None)), (filtering, (301, 130))):
        monkeypatch.setattr(module, "CHUNK", sizes[0])
        if sizes[1]:
            monkeypatch.setattr(module, "BATCH", sizes[1])
    information = accumulate_information(model, base, Observations((run,), BANDS[band]))
    counted = with_hysteresis_states(model, run, BANDS[band]).mask
    rows = (
        dense((model, base, torque), run)[run.rows]
        if band == "open"
        else filtered((model, base, torque), run, BANDS[band])
    )
    assert_says(information, rows * counted[:, :, None], SETTLED)
    assert np.array_equal(information.rows.sum(axis=0), counted.sum(axis=0))
    since = joints_known_from(model, motion)
    low = low_pass(BANDS[band].family, 4, 4.0, 200.0)
    reach = 0 if low is None else edge_samples(low)
    last = motion.samples - (reach if band == "periodic" else 0)
    sure = (run.rows[:, None] >= since + reach) & (run.rows[:, None] < last) & (since < motion.samples)
    assert np.array_equal(counted, np.where(since > 0, sure, True))


@pytest.mark.parametrize("name", OF_JOINTS)
def test_an_unknown_joint_is_refused(name: str):
    robot = ARMS["panda"]
    term = make(name, robot)
    strange = {"nowhere": 1.0, last_two(robot)[0]: 1.0} if isinstance(term.joints, dict) else ("nowhere",)
    with pytest.raises(ArmidError, match="nowhere") as caught:
        dataclasses.replace(term, joints=strange).laws(robot)
    assert robot.joint_names[0] in caught.value.possible


@pytest.mark.parametrize("name", [name for name in OF_JOINTS if name not in MADE])
def test_on_some_joints_only(name: str):
    robot = ARMS["panda"]
    chosen = dataclasses.replace(make(name, robot), joints=last_two(robot))
    assert {law.joint for law in chosen.laws(robot)} == {robot.n - 2, robot.n - 1}
