"""Finding about a plan whose motion is too small or slow to identify the arm, with the limits that are the cause.

A model must predict torque in the whole range of the joints and up to their speed limits (free motion). From the
covariance of the base parameters that is predicted for the plan, the standard deviation of the predicted torque of
each joint in free motion is computed, and divided by the standard deviation of the noise of one torque sample. The
ratio depends neither on the scaling of the parameters nor on the assumed noise.
"""

from __future__ import annotations

import numpy as np

from armid.checked_array import Array
from armid.errors import Finding
from armid.excitation.collision.coal import too_close
from armid.excitation.collision.collision_model import CollisionOptions
from armid.excitation.collision.distances import Clearance
from armid.excitation.design.objective import Objective
from armid.excitation.design.regressor_gradients import Columns
from armid.excitation.design.sqp import DescentProblem, about_start, utilisation
from armid.excitation.limits.joint_limits import Limits
from armid.robot.collision_body_names import BodyPair
from armid.robot.kinematics import forward_kinematics

UNUSABLE = 3.0
"""Standard deviation of the predicted torque of a joint in free motion, divided by the noise of one sample, above
which a plan cannot identify the joint. Plans of ordinary arms reach 0.03 to 0.5. The standard deviation decreases
with the square root of the number of repetitions, so a plan with the value 3 would have to be repeated a hundred
times to reach 0.3."""

GROWN = 1.5
"""Factor by which the amplitudes of a plan are enlarged to find the limits that keep them small."""

TESTED = 10.0
"""Rate of the poses at which collisions are tested along the enlarged motion [Hz]."""

HELD = 0.8
"""Utilisation of a limit at standstill in the start pose above which the finding also names the start pose as a
reason."""

NAMED = 4
"""Largest number of limits and pairs of bodies that the finding names."""

REMEDIES = {
    "torque": "--limit JOINT.effort=VALUE or --torque-margin, if the drives are stronger or springs support the arm",
    "collision": "--ignore-pair A,B or --srdf FILE, if described bodies are too large, or a smaller --clearance",
    "position": "--limit JOINT.position=LOW:HIGH",
    "velocity": "--limit JOINT.velocity=VALUE",
    "acceleration": "--acceleration",
    "jerk": "--jerk",
    "tip": "--tip-box",
}
"""Options of `armid excite` that relax a limit, by the kind of the limit."""


def weak_motion(
    problem: DescentProblem,
    x: Array,
    limits: Limits,
    collision: CollisionOptions | None = None,
    *,
    settled: bool = True,
) -> Finding | None:
    """Finding that names the joints that a plan cannot identify, reasons and remedies; `None` without such joints.

    Args:
        problem: Criterion and limits of the design.
        x: Unknowns of the plan, shape (n k,).
        limits: Limits of the joints.
        collision: Pairs of bodies that must keep a distance; `None` for no collision check.
        settled: True if the search converged before its time limit.
    """
    deviations = deviations_in_free_motion(problem, x, limits)
    weak = np.flatnonzero(~(deviations <= UNUSABLE))
    if not len(weak):
        return None
    joints = limits.joints
    shares = np.abs(problem.fine.states(x)[1]).max(axis=0) / limits.velocity
    order = weak[np.argsort(-deviations[weak], kind="stable")]
    torques = ", ".join(f"{joints[j]} {deviations[j]:.2g}" for j in order)
    speeds = ", ".join(f"{joints[j]} {100.0 * shares[j]:.0f} %" for j in np.argsort(shares)[:NAMED])
    evidence = (
        "The motion is too small or slow to identify the arm. In free motion up to the speed limits, the torque "
        "predicted by its model would have these standard deviations, divided by the noise of one sample: "
        f"{torques}; a model is usable only up to {UNUSABLE:g}. Slowest joints: {speeds} of their speed limits"
    )
    reasons, kinds, is_held = _reasons(problem, x, collision)
    remedies = [REMEDIES[kind] for kind in kinds if kind in REMEDIES]
    if is_held:
        remedies.append("another start pose with --start, or --free-start")
    if not settled:
        reasons.append("the search reached its time limit before it had converged")
        remedies.append("a longer --budget")
    evidence += f". Reasons: {'; '.join(reasons)}" if reasons else ""
    remedy = f"try {'; '.join(remedies or ['a longer --budget', 'another --start'])}."
    return Finding("motion-weak", "warning", ", ".join(joints[j] for j in order), evidence, remedy)


def deviations_in_free_motion(problem: DescentProblem, x: Array, limits: Limits) -> Array:
    """Predicted standard deviation of each joint's torque in free motion, divided by the noise, shape (n,).

    The noise is the standard deviation of one torque sample. The free motion is a random series of the same period as
    the plan, in which each joint reaches a limit of position, velocity, acceleration or jerk. Limits of torque and
    collisions are not taken into account. A joint without position limits moves by half a turn in each direction.
    """
    goal, basis = problem.goal, problem.basis
    grid = Objective(goal, basis, max(round(goal.rate * basis.period), 40 * basis.harmonics))
    covariance = np.linalg.inv(grid.information(x))
    drawn = np.random.default_rng(0).uniform(-1.0, 1.0, (basis.n, 2 * basis.harmonics + 1))
    unknowns = basis.project(drawn).reshape(basis.n, -1).T
    states = [matrix @ unknowns for matrix in grid.matrices]
    states[0] -= 0.5 * (states[0].max(axis=0) + states[0].min(axis=0))
    bounded = np.isfinite(limits.upper - limits.lower)
    low, high = np.where(bounded, limits.lower, -np.pi), np.where(bounded, limits.upper, np.pi)
    bounds = (0.5 * (high - low), limits.velocity, limits.acceleration, limits.jerk)
    share = np.max([np.abs(state).max(axis=0) / bound for state, bound in zip(states, bounds, strict=True)], axis=0)
    q, dq, ddq = (state / share for state in states[:3])
    columns = Columns(goal.source, len(q))
    columns.fill(q + 0.5 * (high + low), dq, ddq)
    powers = [(columns.information(row) * covariance).sum() / len(q) for row in np.eye(basis.n)]
    return np.sqrt(np.maximum(powers, 0.0)) / goal.noise


def _reasons(
    problem: DescentProblem, x: Array, collision: CollisionOptions | None
) -> tuple[list[str], list[str], bool]:
    """Texts on the limits that keep the amplitudes of a plan small, the most exceeded ones first.

    Returns:
        The reasons, the kinds of the limits that a larger motion exceeds, and true if standstill in the start pose
        already uses much of a limit.
    """
    basis, robot = problem.basis, problem.goal.model.robot
    larger, still = about_start(basis, x, GROWN), about_start(basis, x, 0.0)
    found: list[tuple[float, str, str]] = []
    held: list[str] = []
    grown, standing = (utilisation(problem, problem.fine, each) for each in (larger, still))
    for channel, u, u0 in zip(problem.channels, grown, standing, strict=True):
        of = "distance of" if isinstance(channel, Clearance) else f"{channel.name} of"
        for label, most, least in zip(channel.labels, u.max(axis=0), u0.max(axis=0), strict=True):
            if most > 1.0:
                found.append((float(most), f"{of} {label}", channel.name))
            if least > HELD and not isinstance(channel, Clearance):
                held.append(f"{100.0 * least:.0f} % of the {channel.name} limit of {label}")
    if collision is not None:
        times = basis.times(max(50, round(TESTED * basis.period)))
        poses = forward_kinematics(robot, basis.excitation(larger).at(times).q)
        for pair, kept in zip(collision.measured, collision.required_distances, strict=True):
            if too_close(collision.shapes, pair, float(kept), poses).any():
                label = BodyPair(*(collision.shapes[k].name for k in pair))
                found.append((1.0, f"distance of {label}", "collision"))
    found.sort(key=lambda each: -each[0])
    reasons: list[str] = []
    if found:
        reasons.append(f"{GROWN:g} times the motion would exceed {', '.join(text for _, text, _ in found[:NAMED])}")
    if held:
        reasons.append(f"standstill in the start pose already takes {', '.join(held[:NAMED])}")
    return reasons, list(dict.fromkeys(kind for _, _, kind in found)), bool(held)
