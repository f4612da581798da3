"""Closed-loop roll-out of an arm whose joints are held to commands by servos, and its derivatives by parameters.

One step of length h from (q, v) to (q + h/2 (v + y), y) solves for the velocity y at its end:

    ID(q + h/2 v, v, (y - v) / h) + J (y - v) / h + F(q + h/2 v, w) = limited(K (c - q - h/2 w) - D w + u)

with the mean velocity w = (v + y) / 2, the inverse dynamics ID of the links, the rotor inertia J, the laws F, and the
stiffness K, damping D, command c and additional torque u of the servo. Spring and smooth laws follow the midpoint
rule, which neither damps nor is unstable at any stiffness; velocity forces of the links are those at the beginning of
the step. Laws of dry friction are taken at y instead of w, so that a joint comes to rest and stays there.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

import armid.kernel._native as _native
from armid.checked_array import Array, array
from armid.errors import ArmidError
from armid.kernel import reference_rollout
from armid.kernel.dispatch import TWIN, compiled_arm, in_use
from armid.kernel.servo_joints import RollOutParameters, ServoJoints
from armid.kernel.tree import Tree


def roll_out(
    tree: Tree,
    inertial: ArrayLike,
    servos: ServoJoints,
    command: ArrayLike,
    torque: ArrayLike | None,
    q: ArrayLike,
    dq: ArrayLike,
    *,
    chosen: str | None = None,
) -> tuple[Array, Array, int]:
    """Motion of an arm whose joints follow commands, in W windows of N steps.

    Args:
        tree: The arm.
        inertial: Inertial parameters of the links, shape (n, 10).
        servos: Servos, laws and the step of the integration.
        command: Mean command of each step, shape (W, N, n) [rad or m].
        torque: Torque that a servo gives beside that of its position error, shape (W, N, n) [N·m or N]; `None` for
            none.
        q: Initial positions, shape (W, n) [rad or m].
        dq: Initial velocities, shape (W, n) [rad/s or m/s].
        chosen: Build of the kernel.

    Returns:
        Positions and velocities, shape (W, N + 1, n), and the number of steps at which the iteration for the velocity
        did not converge.
    """
    command = array(command, (None, None, tree.n), "command")
    windows, steps, n = command.shape
    added = np.empty(0) if torque is None else array(torque, command.shape, "torque")
    start_q, start_dq = array(q, (windows, n), "q"), array(dq, (windows, n), "dq")
    inertial = array(inertial, (n, 10), "inertial")
    chosen = chosen or in_use()
    if chosen == TWIN:
        more = np.zeros_like(command) if torque is None else added
        return reference_rollout.roll_out(tree, inertial, servos, command, more, start_q, start_dq)
    out_q, out_dq = np.empty((windows, steps + 1, n)), np.empty((windows, steps + 1, n))
    out_q[:, 0], out_dq[:, 0] = start_q, start_dq
    unsettled = _native.roll_out(
        chosen,
        compiled_arm(tree),
        inertial,
        _arrays(servos),
        servos.step,
        servos.steep,
        command,
        added,
        out_q,
        out_dq,
    )
    return out_q, out_dq, unsettled


def roll_out_sensitivities(
    tree: Tree,
    inertial: ArrayLike,
    servos: ServoJoints,
    parameters: RollOutParameters,
    command: ArrayLike,
    torque: ArrayLike | None,
    inputs: ArrayLike,
    q: ArrayLike,
    dq: ArrayLike,
    every: int,
    *,
    chosen: str | None = None,
) -> Array:
    """Derivatives of the positions of one window by parameters, at the states every, 2 every and so on.

    The initial state does not depend on the parameters. The derivative of a step follows from the equation that the
    step solves, by the implicit function theorem, so it is that of the computed motion and not of its limit.

    Args:
        tree: The arm.
        inertial: Inertial parameters of the links, shape (n, 10).
        servos: Servos, laws and the step of the integration.
        parameters: Parameters by which the motion is differentiated.
        command: Mean command of each step, shape (N, n) [rad or m].
        torque: Torque beside that of the position error, shape (N, n) [N·m or N]; `None` for none.
        inputs: Torque of a servo for a unit of each input's parameter, shape (e, N).
        q: Positions of the roll-out, shape (N + 1, n) [rad or m].
        dq: Velocities of the roll-out, shape (N + 1, n) [rad/s or m/s].
        every: Number of steps between two states of the result.
        chosen: Build of the kernel.

    Returns:
        Derivatives, shape (N // every, n, count).
    """
    command = array(command, (None, tree.n), "command")
    if every < 1:
        raise ArmidError(f"The number of steps between two states must be at least 1; found {every}.")
    steps, n = command.shape
    added = np.empty(0) if torque is None else array(torque, command.shape, "torque")
    inputs = array(inputs, (len(parameters.input_joint), steps), "inputs")
    q, dq = array(q, (steps + 1, n), "q"), array(dq, (steps + 1, n), "dq")
    inertial = array(inertial, (n, 10), "inertial")
    chosen = chosen or in_use()
    if chosen == TWIN:
        return reference_rollout.sensitivities(
            tree, inertial, servos, parameters, command, np.zeros_like(command) if torque is None else added, inputs,
            q, dq, every,
        )  # fmt: skip
    out, start = np.empty((steps // every, n, parameters.count)), np.zeros((n, parameters.count))
    wanted = _native.ParameterArrays(
        parameters.count, parameters.links.offset, parameters.links.target, parameters.links.parameter,
        parameters.law, parameters.joint, parameters.input_joint, parameters.input_parameter, inputs,
    )  # fmt: skip
    _native.roll_out_sensitivities(
        chosen, compiled_arm(tree), inertial, _arrays(servos), servos.step, servos.steep, wanted, command, added,
        q, dq, start, start, every, out,
    )  # fmt: skip
    return out


def _arrays(servos: ServoJoints) -> _native.ServoArrays:
    """Servos and laws as arrays of the compiled kernel."""
    laws = servos.laws
    gains = np.stack([servos.stiffness, servos.damping, servos.limit, servos.armature])
    return _native.ServoArrays(
        gains, laws.first, laws.operation, laws.constant, laws.link, laws.joint, laws.weight, servos.values
    )
