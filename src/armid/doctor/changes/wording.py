"""Sentences about a change within a log: when, what, how much."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from armid.doctor.changes.excluded_part import block_edges
from armid.doctor.changes.judgement import angle_between
from armid.doctor.changes.refine import FittedChange
from armid.doctor.changes.shapes import BLOCKS


def evidence_of(each: FittedChange, names: Sequence[str], units: Sequence[str]) -> str:
    """Sentences of a finding: time, change, residual.

    Args:
        each: The change.
        names: Names of the joints.
        units: Units of their torques.
    """
    what = SENTENCES[each.candidate.alternative.kind](each, names, units)
    which = "" if each.candidate.shape.form != "step" else " Either of the two parts may be the wrong one."
    return (
        f"{_when(each)}, {what}. With this change in the model, the residual is {1.0 - np.exp(-each.gain):.0%} "
        f"smaller.{which}"
    )


def channel_of(each: FittedChange, names: Sequence[str]) -> str:
    """Names of the joints that a change concerns; empty for all joints."""
    alternative = each.candidate.alternative
    return "" if alternative.of_all and len(names) > 1 else ", ".join(names[j] for j in alternative.joints)


def _when(each: FittedChange) -> str:
    shape, edges = each.candidate.shape, block_edges(each.state.rows.motion.time)
    if shape.form == "ramp":
        return f"From t = {edges[0]:.1f} s to {edges[-1]:.1f} s, more and more"
    if shape.form == "decay":
        return f"From t = {edges[0]:.1f} s on, and less and less until {edges[-1]:.1f} s"
    inside = np.concatenate([[False], shape.size > 0.0, [False]])
    bounds = np.flatnonzero(np.diff(inside.astype(int)))
    parts = [
        f"from about t = {edges[first]:.1f} s " + ("on" if stop == BLOCKS else f"to {edges[stop]:.1f} s")
        for first, stop in zip(bounds[::2], bounds[1::2], strict=True)
    ]
    listed = " and ".join(parts)
    return listed[0].upper() + listed[1:]


def _torques(each: FittedChange, names: Sequence[str]) -> str:
    alternative = each.candidate.alternative
    if alternative.of_all and len(names) > 1:
        return "all torques are"
    return f"the torque of {' and '.join(names[j] for j in alternative.joints)} is"


def _gain(each: FittedChange, names: Sequence[str], units: Sequence[str]) -> str:
    del units
    factor = float(each.values[0])
    if factor < 0.0:
        return f"{_torques(each, names)} {factor:.2g} times what the rest of the log implies: the sign is opposite"
    return f"{_torques(each, names)} {factor:.2g} times what the rest of the log implies"


def _offset(each: FittedChange, names: Sequence[str], units: Sequence[str]) -> str:
    joints = each.candidate.alternative.joints
    sizes = ", ".join(f"{float(x):+.3g} {units[j]}" for j, x in zip(joints, each.values, strict=True))
    return f"{_torques(each, names)} shifted by {sizes} against the rest of the log"


def _friction(each: FittedChange, names: Sequence[str], units: Sequence[str]) -> str:
    pairs = zip(each.candidate.alternative.frictional, each.values, strict=True)
    listed = ", ".join(f"{names[j]} {float(x):+.2g} {units[j]}" for j, x in pairs)
    return f"dry friction differs from that in the rest of the log: {listed}"


def _order(each: FittedChange, names: Sequence[str], units: Sequence[str]) -> str:
    del units
    i, j = each.candidate.alternative.joints
    return f"the torques of {names[i]} and {names[j]} are exchanged"


def _talk(each: FittedChange, names: Sequence[str], units: Sequence[str]) -> str:
    del units
    j, k = each.candidate.alternative.joints
    return f"the torque of {names[j]} contains {float(each.values[0]):.2g} times the torque of {names[k]}"


def _scale(each: FittedChange, names: Sequence[str], units: Sequence[str]) -> str:
    del units
    (j,) = each.candidate.alternative.joints
    return (
        f"the torques do not fit the positions of {names[j]}: with another scale, or another sign, and another zero "
        "they fit better"
    )


def _zero(each: FittedChange, names: Sequence[str], units: Sequence[str]) -> str:
    (j,) = each.candidate.alternative.joints
    unit = "rad" if units[j] == "N·m" else "m"
    return (
        f"the torques fit positions of {names[j]} that differ by {float(each.values[0]):+.3f} {unit} from the logged "
        "ones, as after a slip of the encoder"
    )


def _balance(each: FittedChange, names: Sequence[str], units: Sequence[str]) -> str:
    (j,) = each.candidate.alternative.joints
    largest = float(np.abs(each.torque[:, j]).max(initial=0.0))
    return (
        f"{_torques(each, names)} changed by a part that follows its angle as a weight does, up to {largest:.3g} "
        f"{units[j]}: a balancer or a spring loses its force, or gains it"
    )


def _payload(each: FittedChange, names: Sequence[str], units: Sequence[str]) -> str:
    del names, units
    mass = float(each.values[0])
    centre = ", ".join(f"{float(x) / mass:.2f}" for x in each.values[1:])
    return f"the last link carries {mass:+.2g} kg (centre at {centre} m in its frame) against the rest of the log"


def _gravity(each: FittedChange, names: Sequence[str], units: Sequence[str]) -> str:
    del names, units
    g = np.asarray(each.state.model.robot.gravity)
    listed = ", ".join(f"{float(x):.2f}" for x in g + each.values)
    return f"gravity is tilted by {np.degrees(angle_between(g, g + each.values)):.0f}°, to ({listed}) m/s²"


def _delay(each: FittedChange, names: Sequence[str], units: Sequence[str]) -> str:
    del units
    seconds = float(each.values[0])
    when = "late" if seconds > 0.0 else "early"
    return f"{_torques(each, names)} {abs(seconds) * 1e3:.0f} ms {when} against the rest of the log"


SENTENCES: Mapping[str, Callable[[FittedChange, Sequence[str], Sequence[str]], str]] = {
    "gain": _gain,
    "offset": _offset,
    "friction": _friction,
    "order": _order,
    "zero": _zero,
    "scale": _scale,
    "talk": _talk,
    "balance": _balance,
    "payload": _payload,
    "gravity": _gravity,
    "delay": _delay,
}
"""Text about a change, by the kind of the change."""
