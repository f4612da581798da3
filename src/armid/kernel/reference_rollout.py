"""NumPy twin of the closed-loop roll-out: one step after another, with the derivatives that differences give exactly.

The scheme is described in `armid.kernel.rollout`.
"""

from __future__ import annotations

import numpy as np

from armid.checked_array import Array
from armid.kernel import reference
from armid.kernel.reference_adjoint import STEPS, TURNS
from armid.kernel.reference_laws import law_torques
from armid.kernel.servo_joints import OPERATIONS, RollOutParameters, ServoJoints
from armid.kernel.tree import Tree

PASSES = 40
"""Largest number of Newton passes of a step, as in the compiled kernel."""

SETTLED = 1e-11
"""Change of a velocity, relative to 1 plus its size, at which the passes end, as in the compiled kernel."""


def roll_out(
    tree: Tree, inertial: Array, servos: ServoJoints, command: Array, torque: Array, q: Array, dq: Array
) -> tuple[Array, Array, int]:
    """Positions and velocities (W, N + 1, n), and the number of steps that did not converge."""
    windows, steps, n = command.shape
    out_q, out_dq = np.empty((windows, steps + 1, n)), np.empty((windows, steps + 1, n))
    out_q[:, 0], out_dq[:, 0] = q, dq
    unsettled = 0
    for w in range(windows):
        for s in range(steps):
            at, rate = out_q[w, s], out_dq[w, s]
            y, settled = _step(tree, inertial, servos, command[w, s], torque[w, s], at, rate)
            out_q[w, s + 1], out_dq[w, s + 1] = at + 0.5 * servos.step * (rate + y), y
            unsettled += not settled
    return out_q, out_dq, unsettled


def _servo_torque(servos: ServoJoints, c: Array, u: Array, q: Array, v: Array, y: Array) -> Array:
    """Torque of the servos before their limit, shape (n,)."""
    return servos.stiffness * (c - q - 0.25 * servos.step * (v + y)) - 0.5 * servos.damping * (v + y) + u


def _step(
    tree: Tree, inertial: Array, servos: ServoJoints, c: Array, u: Array, q: Array, v: Array
) -> tuple[Array, bool]:
    """Velocities at the end of a step, and true if the iteration converged."""
    h, n = servos.step, tree.n
    middle = q + 0.5 * h * v
    M = reference.mass_matrix(tree, inertial, middle[None])[0] + np.diag(servos.armature)
    bias = reference.inverse_dynamics(tree, inertial, middle[None], v[None], np.zeros((1, n)))[0]
    dry = OPERATIONS.index("sign") in servos.laws.operation
    y = v.copy()
    for _ in range(PASSES):
        laws = law_torques(servos.laws, servos.values, servos.steep, middle, v, y)
        raw = _servo_torque(servos, c, u, q, v, y)
        G = M @ (y - v) / h + bias + laws.torque - np.clip(raw, -servos.limit, servos.limit)
        slope = np.where(np.abs(raw) < servos.limit, 0.25 * h * servos.stiffness + 0.5 * servos.damping, 0.0)
        rising = np.where(laws.by_y < 0.0, 0.0, laws.by_y)
        new = y - np.linalg.solve(M / h + rising + np.diag(slope), G)
        if dry:
            new = np.where(new * y < 0.0, 0.0, new)
        moved = np.abs(new - y) > SETTLED * (1.0 + np.abs(new))
        y = new
        if not moved.any():
            return y, bool(np.isfinite(y).all())
    return y, False


def sensitivities(
    tree: Tree,
    inertial: Array,
    servos: ServoJoints,
    parameters: RollOutParameters,
    command: Array,
    torque: Array,
    inputs: Array,
    q: Array,
    dq: Array,
    every: int,
) -> Array:
    """Derivatives of the positions by parameters, shape (N // every, n, count)."""
    h, n, count = servos.step, tree.n, parameters.count
    S_q, S_dq = np.zeros((n, count)), np.zeros((n, count))
    out = np.empty((len(command) // every, n, count))
    for s in range(len(command)):
        at, v, y = q[s], dq[s], dq[s + 1]
        middle, a = at + 0.5 * h * v, (y - v) / h
        M, by_q, by_dq = _derivatives(tree, inertial, middle, v, a)
        laws = law_torques(servos.laws, servos.values, servos.steep, middle, v, y)
        raw = _servo_torque(servos, command[s], torque[s], at, v, y)
        inside = np.abs(raw) < servos.limit
        spring = np.diag(np.where(inside, servos.stiffness, 0.0))
        damping = np.diag(np.where(inside, servos.damping, 0.0))
        mass = (M + np.diag(servos.armature)) / h
        A = mass + laws.by_y + 0.5 * damping + 0.25 * h * spring
        G_q = by_q + laws.by_q + spring
        G_v = 0.5 * h * (by_q + laws.by_q) + by_dq + laws.by_v - mass + 0.5 * damping + 0.25 * h * spring
        rhs = -G_q @ S_q - G_v @ S_dq - _sources(tree, servos, parameters, middle, v, a, laws.each)
        error = command[s] - at - 0.25 * h * (v + y)
        by_joint = (-a, inside * error, -0.5 * inside * (v + y), np.where(inside, 0.0, np.sign(raw)))
        for number, joint_source in zip(parameters.joint, by_joint, strict=True):
            for j in np.flatnonzero(number >= 0):
                rhs[j, number[j]] += joint_source[j]
        for e, (j, p) in enumerate(zip(parameters.input_joint, parameters.input_parameter, strict=True)):
            rhs[j, p] += inside[j] * inputs[e, s]
        S_y = np.linalg.solve(A, rhs)
        S_q, S_dq = S_q + 0.5 * h * (S_dq + S_y), S_y
        if (s + 1) % every == 0:
            out[(s + 1) // every - 1] = S_q
    return out


def _derivatives(tree: Tree, inertial: Array, q: Array, v: Array, a: Array) -> tuple[Array, Array, Array]:
    """Mass matrix, and derivatives of inverse dynamics by positions and velocities, shape (n, n) each."""
    n = tree.n
    states: list[tuple[Array, Array, float, int, int]] = []
    for j in range(n):
        unit = np.eye(n)[j]
        for kind in (0, 1):
            for step, factor in TURNS if kind == 0 and not tree.prismatic[j] else STEPS:
                for sense in (1.0, -1.0):
                    moved = sense * step * unit
                    states.append(
                        (q + moved, v, sense * factor, 0, j) if kind == 0 else (q, v + moved, sense * factor, 1, j)
                    )
    at = np.array([state[0] for state in states]), np.array([state[1] for state in states])
    torque = reference.inverse_dynamics(tree, inertial, *at, np.tile(a, (len(states), 1)))
    slopes = np.zeros((2, n, n))
    for (_, _, factor, kind, j), tau in zip(states, torque, strict=True):
        slopes[kind, :, j] += factor * tau
    return reference.mass_matrix(tree, inertial, q[None])[0], slopes[0], slopes[1]


def _sources(
    tree: Tree, servos: ServoJoints, parameters: RollOutParameters, q: Array, v: Array, a: Array, laws: Array
) -> Array:
    """Torque for a unit of each inertial parameter and law, shape (n, count)."""
    found = np.zeros((tree.n, parameters.count))
    programs = servos.laws
    for e in np.flatnonzero(parameters.law >= 0):
        own = slice(programs.link[e], programs.link[e + 1])
        found[programs.joint[own], parameters.law[e]] += programs.weight[own] * laws[e]
    if not len(parameters.links.target):
        return found
    Y = reference.regressor(tree, q[None], v[None], a[None])[0]
    pairs = [(i, j) for i in range(tree.n) for j in tree.ancestors(i)]
    for (i, j), targets in zip(pairs, parameters.links.target.reshape(-1, 10), strict=True):
        for k in np.flatnonzero(targets >= 0):
            found[j, parameters.links.parameters[j][targets[k]]] += Y[j, 10 * i + k]
    return found
