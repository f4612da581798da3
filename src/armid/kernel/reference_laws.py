"""NumPy twin of torque laws: programs on a stack, with derivatives by position and velocity of their coordinate."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from armid.checked_array import Array
from armid.kernel.servo_joints import OPERATIONS, LawPrograms


class Dual(NamedTuple):
    """Value with its derivatives by position and velocity of a coordinate."""

    value: float
    by_q: float
    by_dq: float


class LawTorques(NamedTuple):
    """Torque of all laws at one state.

    Attributes:
        each: Value of each law, without its parameter, shape (l,).
        torque: Torque of each joint, shape (n,).
        by_q: Derivative of the torque by the positions, shape (n, n).
        by_v: Derivative of the torque by the velocities at the beginning of the step, shape (n, n).
        by_y: Derivative of the torque by the velocities at the end of the step, shape (n, n).
    """

    each: Array
    torque: Array
    by_q: Array
    by_v: Array
    by_y: Array


def law_torques(laws: LawPrograms, values: Array, steep: float, q: Array, v: Array, y: Array) -> LawTorques:
    """Torque of laws with the parameters `values` in a step, at positions q and velocities v to y, shape (n,) each.

    A law with a sign is taken at y, every other one at the mean of v and y.
    """
    n = len(q)
    found = LawTorques(np.zeros(laws.count), np.zeros(n), *np.zeros((3, n, n)))
    for e in range(laws.count):
        own = slice(laws.link[e], laws.link[e + 1])
        joint, weight = laws.joint[own], laws.weight[own]
        dry = OPERATIONS.index("sign") in laws.operation[laws.first[e] : laws.first[e + 1]]
        rate = y[joint] if dry else 0.5 * (v[joint] + y[joint])
        law = _run(laws, e, float(weight @ q[joint]), float(weight @ rate), steep)
        both = values[e] * np.outer(weight, weight)
        found.each[e] = law.value
        np.add.at(found.torque, joint, values[e] * weight * law.value)
        found.by_q[np.ix_(joint, joint)] += both * law.by_q
        found.by_y[np.ix_(joint, joint)] += both * law.by_dq * (1.0 if dry else 0.5)
        found.by_v[np.ix_(joint, joint)] += both * law.by_dq * (0.0 if dry else 0.5)
    return found


def _run(laws: LawPrograms, which: int, q: float, dq: float, steep: float) -> Dual:
    """Value of a law at one position and velocity of its coordinate."""
    stack: list[Dual] = []
    for k in range(laws.first[which], laws.first[which + 1]):
        name, constant = OPERATIONS[laws.operation[k]], float(laws.constant[k])
        match name:
            case "number":
                stack.append(Dual(constant, 0.0, 0.0))
            case "q":
                stack.append(Dual(q, 1.0, 0.0))
            case "dq":
                stack.append(Dual(dq, 0.0, 1.0))
            case "add" | "mul" | "max" | "min":
                b, a = stack.pop(), stack.pop()
                stack.append(_joined(name, a, b))
            case _:
                stack.append(_of_one(name, stack.pop(), constant, steep))
    return stack[0]


def _joined(name: str, a: Dual, b: Dual) -> Dual:
    if name == "add":
        return Dual(*(x + y for x, y in zip(a, b, strict=True)))
    if name == "mul":
        return Dual(a.value * b.value, a.by_q * b.value + a.value * b.by_q, a.by_dq * b.value + a.value * b.by_dq)
    share = 0.5 * (1.0 + np.sign(a.value - b.value if name == "max" else b.value - a.value))
    return Dual(*(share * x + (1.0 - share) * y for x, y in zip(a, b, strict=True)))


def _of_one(name: str, a: Dual, constant: float, steep: float) -> Dual:
    x = a.value
    with np.errstate(all="ignore"):
        match name:
            case "pow":
                value, slope = np.power(x, constant), constant * np.power(x, constant - 1.0)
                slope = slope if np.isfinite(slope) else 0.0
            case "sign":
                inside = abs(x) < steep
                value, slope = (x / steep, 1.0 / steep) if inside else (np.sign(x), 0.0)
            case "tanh":
                value = np.tanh(x)
                slope = 1.0 - value * value
            case "abs":
                value, slope = abs(x), np.sign(x)
            case "exp":
                value = slope = np.exp(x)
            case "sin":
                value, slope = np.sin(x), np.cos(x)
            case _:
                value, slope = np.cos(x), -np.sin(x)
    return Dual(float(value), float(slope * a.by_q), float(slope * a.by_dq))
