"""The closed-loop roll-out: every build follows the twin, its derivatives are those of the motion, and its scheme
keeps the laws of mechanics."""

from __future__ import annotations

import numpy as np
import pytest

from armid import kernel
from armid.errors import ArmidError
from armid.kernel import LawPrograms, RollOutParameters, ServoJoints, make_layout
from armid.model.terms import Coulomb, Stribeck, Viscous
from armid.model.terms.law_programs import law_programs
from armid.model.terms.term import Law
from armid.model.torque_law_expression import cosine, exponential, magnitude, maximum, minimum, sine, symbol, tanh
from problems import COMPILED, TWIN
from trees import iiwa_tree, random_inertial, random_tree, robot_of

AGREEMENT = 1e-8
"""Relative to the largest entry: rounding of 1e-15 grows in a motion that is not damped, here by 1e5 at most."""

SLOPE = 1e-5
"""Of a derivative by central differences with steps of 1e-6, relative to the largest entry."""

NO_LAWS = law_programs([])


def any_laws(rng: np.random.Generator, n: int) -> LawPrograms:
    """Laws with every function, some of them of two joints."""
    q, dq = symbol("q"), symbol("dq")
    expressions = [
        dq,
        tanh(3.0 * dq),
        exponential(-((magnitude(dq) * 2.0) ** 1.5)) * tanh(dq * 5.0),
        sine(2.0 * q) + cosine(q) * dq,
        maximum(dq, 0.2) - minimum(dq, -0.1),
        dq**2.0 * tanh(dq),
    ]
    laws: list[Law] = []
    for k, expression in enumerate(expressions):
        one, other = rng.integers(n), rng.integers(n)
        coordinate = ((int(one), 1.0),) if k % 2 == 0 or one == other else ((int(one), 1.0), (int(other), -0.5))
        laws.append(Law("L", int(one), "", coordinate, expression))
    return law_programs(laws)


def any_servos(rng: np.random.Generator, n: int, laws: LawPrograms) -> ServoJoints:
    limit = np.where(rng.random(n) < 0.3, 2.0, np.inf)
    gains = rng.uniform(5.0, 40.0, n), rng.uniform(0.0, 3.0, n), limit, rng.uniform(0.05, 0.5, n)
    return ServoJoints(*gains, laws, rng.uniform(0.0, 2.0, laws.count), step=4e-3)


def any_motion(rng: np.random.Generator, n: int, windows: int, steps: int):
    start = rng.uniform(-1.0, 1.0, (windows, n))
    command = start[:, None] + np.cumsum(rng.normal(0.0, 0.02, (windows, steps, n)), axis=1)
    return command, rng.normal(0.0, 0.5, (windows, steps, n)), start, rng.uniform(-0.5, 0.5, (windows, n))


def all_parameters(tree, laws: LawPrograms, inputs: int) -> RollOutParameters:
    """Every inertial parameter, law, gain and one input for each joint."""
    n, links = tree.n, 10 * tree.n
    count = links + laws.count + 4 * n + inputs
    layout = make_layout(tree, np.arange(links), np.zeros(0, dtype=int), np.zeros(0, dtype=int))
    gains = links + laws.count + np.arange(4 * n).reshape(4, n)
    return RollOutParameters(
        count, layout, links + np.arange(laws.count), gains, np.arange(inputs), count - inputs + np.arange(inputs)
    )


@pytest.mark.parametrize(("seed", "windows"), [(seed, 1 if seed % 2 else 5) for seed in range(16)])
def test_builds_and_twin_agree(seed, windows):
    """For one window and for several, for arms with more joints than there are lanes, and for short ends of lanes."""
    rng = np.random.default_rng(seed)
    n = 1 + seed if seed < 9 else (10, 17, 2, 4, 7, 12, 3)[seed - 9]
    tree, inertial, laws = random_tree(rng, n), random_inertial(rng, n), any_laws(rng, n)
    servos, motion = any_servos(rng, n, laws), any_motion(rng, n, windows, 25)
    q, dq, unsettled = kernel.roll_out(tree, inertial, servos, *motion, chosen=TWIN)
    parameters, inputs = all_parameters(tree, laws, n), rng.normal(size=(n, 25))
    first = motion[0][0], motion[1][0], inputs, q[0], dq[0], 5
    S = kernel.roll_out_sensitivities(tree, inertial, servos, parameters, *first, chosen=TWIN)
    assert unsettled == 0
    for build in COMPILED:
        found = kernel.roll_out(tree, inertial, servos, *motion, chosen=build)
        assert np.abs(found[0] - q).max() < AGREEMENT * np.abs(q).max()
        assert np.abs(found[1] - dq).max() < AGREEMENT * np.abs(dq).max()
        assert found[2] == 0
        own = kernel.roll_out_sensitivities(tree, inertial, servos, parameters, *first, chosen=build)
        assert own.shape == (5, n, parameters.count)
        assert np.abs(own - S).max() < AGREEMENT * np.abs(S).max()


@pytest.mark.parametrize("seed", range(4))
def test_derivatives_are_those_of_the_motion(seed):
    """Each parameter is moved by 1e-6 to both sides."""
    rng = np.random.default_rng(100 + seed)
    n, steps = 3, 60
    tree, inertial, laws = random_tree(rng, n), random_inertial(rng, n), any_laws(rng, n)
    servos = any_servos(rng, n, laws)
    command, torque, start, speed = any_motion(rng, n, 1, steps)
    inputs, parameters = rng.normal(size=(n, steps)), all_parameters(tree, laws, n)
    theta = np.concatenate(
        [
            inertial.ravel(),
            servos.values,
            servos.armature,
            servos.stiffness,
            servos.damping,
            servos.limit,
            np.zeros(n),
        ]
    )
    assert np.isfinite(servos.limit).any()

    def moved(theta):
        ends = np.cumsum([10 * n, laws.count, n, n, n, n])
        bodies, values, armature, stiffness, damping, limit, more = np.split(theta, ends)
        own = ServoJoints(stiffness, damping, limit, armature, laws, values, servos.step)
        added = torque + (more[:, None] * inputs).T
        return kernel.roll_out(tree, bodies.reshape(n, 10), own, command, added, start, speed)

    q, dq, _ = moved(theta)
    S = kernel.roll_out_sensitivities(
        tree, inertial, servos, parameters, command[0], torque[0], inputs, q[0], dq[0], 10
    )
    for k in range(parameters.count):
        step = 1e-6 * np.eye(parameters.count)[k]
        by_differences = (moved(theta + step)[0] - moved(theta - step)[0])[0, 10::10] / 2e-6
        assert np.abs(by_differences - S[:, :, k]).max() < SLOPE * max(1.0, np.abs(S[:, :, k]).max())


def test_derivatives_with_dry_friction():
    """Differences agree for joints that stick and slide, while no step changes from one to the other."""
    rng = np.random.default_rng(3)
    tree, inertial = iiwa_tree(), random_inertial(rng, 7)
    laws = law_programs(
        [*Viscous().laws(robot_of(tree)), *Coulomb(0.0).laws(robot_of(tree)), *Stribeck(0.1).laws(robot_of(tree))]
    )
    values = np.concatenate([np.full(7, 2.0), np.full(7, 3.0), np.full(7, 0.5)])
    gains = np.full(7, 400.0), np.zeros(7), np.full(7, np.inf)
    t = 0.002 * np.arange(500)
    command = 0.3 * np.sin(2.0 * np.pi * np.outer(t, np.linspace(0.3, 1.0, 7)))[None]
    layout = make_layout(tree, np.full(70, -1), np.zeros(0, dtype=int), np.zeros(0, dtype=int))
    parameters = RollOutParameters(
        7, layout, np.full(21, -1), [np.full(7, -1), np.arange(7), *np.full((2, 7), -1)], [], []
    )

    def moved(stiffness):
        servos = ServoJoints(stiffness, *gains[1:], np.full(7, 0.5), laws, values, step=0.002)
        return servos, kernel.roll_out(tree, inertial, servos, command, None, command[:, 0], np.zeros((1, 7)))

    servos, (q, dq, unsettled) = moved(gains[0])
    assert unsettled == 0
    assert (np.abs(dq[0]) < servos.steep).any(axis=0).all()  # each joint sticks at times
    none = np.zeros((0, 500))
    S = kernel.roll_out_sensitivities(tree, inertial, servos, parameters, command[0], None, none, q[0], dq[0], 50)
    for j in range(7):
        step = 1e-5 * np.eye(7)[j]
        by_differences = (moved(gains[0] + step)[1][0] - moved(gains[0] - step)[1][0])[0, 50::50] / 2e-5
        # A change of a stick's end by one step of 2 ms is a relative change of about 1 %.
        assert np.abs(by_differences - S[:, :, j]).max() < 0.02 * np.abs(S).max()


def test_energy_of_springs_is_kept():
    """Without friction and damping, the midpoint rule keeps the energy of arm and springs, to second order."""
    rng = np.random.default_rng(0)
    tree, inertial = random_tree(rng, 4, branching=0.5), random_inertial(rng, 4)
    start, lost = rng.uniform(-0.5, 0.5, (1, 4)), []
    for step in (2e-3, 1e-3):
        servos = ServoJoints(
            np.full(4, 60.0), np.zeros(4), np.full(4, np.inf), np.full(4, 0.3), NO_LAWS, np.zeros(0), step
        )
        steps = round(1.0 / step)
        q, dq, _ = kernel.roll_out(tree, inertial, servos, np.zeros((1, steps, 4)), None, start, np.zeros((1, 4)))
        M = kernel.mass_matrix(tree, inertial, q[0]) + 0.3 * np.eye(4)
        kinetic = 0.5 * np.einsum("ni,nij,nj->n", dq[0], M, dq[0])
        energy = kinetic + kernel.potential_energy(tree, inertial, q[0]) + 30.0 * np.sum(q[0] ** 2, axis=1)
        lost.append(np.abs(energy - energy[0]).max() / kinetic.max())
    assert lost[1] < 0.02
    assert lost[1] < 0.6 * lost[0]  # at least of first order


def test_dry_friction_holds_a_load():
    """A joint whose load is below its dry friction keeps its place for ten seconds."""
    tree = random_tree(np.random.default_rng(5), 1, prismatic=0.0)
    inertial = random_inertial(np.random.default_rng(5), 1)
    load = float(np.abs(kernel.gravity_torque(tree, inertial, np.array([[0.3]])))[0, 0])
    robot = robot_of(tree)
    laws = law_programs(Coulomb(0.0).laws(robot))
    servos = ServoJoints([0.0], [0.0], [np.inf], [0.1], laws, [1.05 * load], 1e-3)
    q, _, _ = kernel.roll_out(tree, inertial, servos, np.zeros((1, 10_000, 1)), None, [[0.3]], [[0.0]])
    assert np.abs(q - 0.3).max() < 10.0 * servos.steep
    slipping = ServoJoints([0.0], [0.0], [np.inf], [0.1], laws, [0.95 * load], 1e-3)
    q, _, _ = kernel.roll_out(tree, inertial, slipping, np.zeros((1, 10_000, 1)), None, [[0.3]], [[0.0]])
    assert np.abs(q - 0.3).max() > 0.1


def test_wrong_shapes_are_refused():
    tree, servos = iiwa_tree(), any_servos(np.random.default_rng(0), 7, NO_LAWS)
    bodies = random_inertial(np.random.default_rng(0), 7)
    with pytest.raises(ArmidError, match="command must have shape"):
        kernel.roll_out(tree, bodies, servos, np.zeros((5, 7)), None, np.zeros((1, 7)), np.zeros((1, 7)))
    with pytest.raises(ArmidError, match="q must have shape"):
        kernel.roll_out(tree, bodies, servos, np.zeros((1, 5, 7)), None, np.zeros((2, 7)), np.zeros((1, 7)))
    with pytest.raises(ArmidError, match="must not be negative"):
        ServoJoints([-1.0], [0.0], [1.0], [0.0], NO_LAWS, [], 1e-3)
