"""Decision whether a fitted change is a fault, or an effect of the arm that the model lacks.

Every log of a real arm fits better if something may change in it: gears warm up, and friction depends on more than a
model contains. The thresholds are above what sound logs give: all recordings of eight arms, whole and in halves, and
forty logs of the lab. Damage by a smaller change was below 30 % of the error on unseen motion.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from armid.checked_array import Array
from armid.doctor.changes.alternatives import alternatives_of
from armid.doctor.changes.refine import FittedChange
from armid.doctor.changes.scan import ChangeCandidate, scan
from armid.doctor.fitted_log import LogState

SCREENED = 0.04
"""Decrease of the squared residuals in the linearised search from which a change is fitted: half of the smallest one
that is reported."""

MOST = 10
"""Largest number of changes that are fitted; the right one was among the first four in all corrupted recordings."""

TOGETHER = 0.7
"""Sum of the changes of friction, in units of each joint's residual, over the sum of their amounts, from which
friction changes on all joints together, as it does when gears warm up. Model error differs from joint to joint."""

SLOW = 0.06
"""Velocity below which dry friction may have any value up to its bound [rad/s or m/s]: three smoothing widths."""

RESTING = 0.8
"""Share of the changed rows in which all joints are slow, above which a change is static friction at rest."""

FACTOR = 0.15
"""Smallest amount of the logarithm of a factor on a torque: drive gains are not known better."""

ANGLE = (0.02, 0.6)
"""Smallest and largest change of a zero [rad or m]. A larger one is a joint whose pose hardly matters."""

SCALE = 0.05
"""Smallest relative change of the scale of a position; a smaller one is a change of its zero."""

TALK = 0.1
"""Smallest share of another torque that is added."""

DELAY = (0.02, 1.0)
"""Smallest and largest change of a delay [s]; filters of drives explain smaller ones."""

ARM = 0.35
"""Largest distance of the centre of a payload from the origin of the last link [m]. Model error asks for payloads
without mass, or far away."""

TILT, STRENGTH = np.radians(4.0), 0.25
"""Smallest change of the direction of gravity [rad], and largest relative change of its strength: a base tilts, and
keeps its weight."""


STILL = 1e-3
"""Speed that a joint which never moves does not reach [rad/s or m/s]. Its torque may have any value within static
friction, and that of a stuck encoder contradicts its position, so that parts of the log cannot be compared."""

CONSTANT = 0.88
"""Share of a change's decrease of the squared residuals that a constant fault of the same kind gives, from which the
fault is constant. A change of half a log gives 0.5."""

FADING = 0.8
"""`CONSTANT` for a torque that balances a weight: where a joint moves little, a constant spring that the model lacks
looks like one that fades."""


@dataclass(frozen=True, slots=True)
class Threshold:
    """Smallest change that is reported.

    Attributes:
        gain: Decrease of the mean over the joints of the logarithm of the RMS residual.
        steady: Share of the linearised decrease in that of coefficients that differ from block to block.
        share: RMS torque of the change over the standard deviation of the torque, of the joint where it is largest.
    """

    gain: float
    steady: float
    share: float


OF_ONE: Mapping[str, Threshold] = {
    "gain": Threshold(0.11, 0.0, 0.2),
    "offset": Threshold(0.11, 0.7, 0.45),
    "friction": Threshold(0.08, 0.75, 0.2),
    "order": Threshold(0.15, 0.0, 0.2),
    "zero": Threshold(0.12, 0.7, 0.15),
    "scale": Threshold(0.3, 0.6, 0.15),
    "delay": Threshold(0.1, 0.6, 0.05),
    "talk": Threshold(0.2, 0.85, 0.2),
    "balance": Threshold(0.11, 0.75, 0.1),
}
"""Thresholds of changes of one joint, or of two joints. Largest values on sound recordings: gain 0.06, offset 0.11
with a share of 0.15, friction 0.04, zero 0.05, scale 0.10, delay 0.08, talk 0.15,
balance 0.09 within `FADING`. In halves of them, some of ten
seconds, scale is up to 0.30 and talk up to 0.19."""

GRADUAL: Mapping[str, Threshold] = {"offset": Threshold(0.07, 0.6, 0.45)}
"""Thresholds of ramps and decays of one joint that differ from `OF_ONE`. Three of these shapes are compared, and 171
steps, so that model error looks less like them: by at most 0.04 on sound recordings."""

OF_ALL: Mapping[str, Threshold] = {
    "gain": Threshold(0.22, 0.0, 0.1),
    "offset": Threshold(0.2, 0.4, 0.2),
    "friction": Threshold(0.15, 0.4, 0.05),
    "delay": Threshold(0.05, 0.85, 0.05),
    "payload": Threshold(0.2, 0.5, 0.15),
    "gravity": Threshold(0.2, 0.5, 0.1),
}
"""Thresholds of changes of the whole arm. Largest values on sound recordings: gain 0.06, friction 0.12, payload 0.12,
gravity 0.27 with a tilt of 2°."""


@lru_cache(maxsize=4)
def change_of(state: LogState) -> FittedChange | None:
    """The change that explains the misfit of a log best, if it is a fault.

    The result is `None` if nothing changes, if a joint never moves, or if a change was corrected already.
    """
    if state.change_corrected or state.log.band.is_open:
        return None
    if (np.abs(state.rows.motion.dq).max(axis=0, initial=0.0) < STILL).any():
        return None
    found = [each for each in scan(state, alternatives_of(state))[:MOST] if each.gain > SCREENED]
    fitted = [FittedChange(state, each) for candidate in found for each in _variants(candidate)]
    faults = [each for each in fitted if is_fault(each)]
    return max(faults, key=lambda each: each.gain, default=None)


def _variants(candidate: ChangeCandidate) -> list[ChangeCandidate]:
    """A candidate, and the plain change of sign for a negative factor."""
    if candidate.alternative.kind != "gain" or candidate.values[0] > 0.0:
        return [candidate]
    return [candidate, candidate.with_values(np.array([-1.0]))]


def is_fault(each: FittedChange) -> bool:
    """True if a change is larger and steadier than effects that the model lacks, and physically possible."""
    alternative = each.candidate.alternative
    least = threshold_of(each.candidate)
    if each.candidate.constant > CONSTANT or _rests(each):
        return False
    if each.gain < least.gain or each.candidate.steady < least.steady or each.share.max() < least.share:
        return False
    return POSSIBLE[alternative.kind](each)


def threshold_of(candidate: ChangeCandidate) -> Threshold:
    """Thresholds of a change of one joint, of two, or of the whole arm."""
    kind, gradual = candidate.alternative.kind, candidate.shape.form != "step"
    of_one = {**OF_ONE, **(GRADUAL if gradual else {})}
    known = OF_ALL if len(candidate.alternative.joints) > 2 else of_one
    return known.get(kind) or {**OF_ALL, **of_one}[kind]


def _rests(each: FittedChange) -> bool:
    """True if the arm rests in most rows of the changed part, where static friction can have any value."""
    fastest = np.abs(each.state.rows.motion.dq[each.changed]).max(axis=1, initial=0.0)
    return bool(len(fastest)) and float(np.mean(fastest < SLOW)) > RESTING


def _gain(each: FittedChange) -> bool:
    factor = float(each.values[0])
    return factor < 0.0 or abs(np.log(factor)) > FACTOR


def _offset(each: FittedChange) -> bool:
    """True if an offset is larger than static friction can be while the joint is slow, or grows gradually."""
    if len(each.values) > 1:
        return each.candidate.shape.form != "step"
    state, (j, *_) = each.state, each.candidate.alternative.joints
    rows = state.rows
    inside = rows.mask[:, j] & each.changed
    slow = float(np.mean(np.abs(rows.motion.dq[inside, j]) < SLOW)) if inside.any() else 1.0
    if each.candidate.shape.form != "step":
        return True
    numbered = zip(state.symbols(j), rows.parameters[j], strict=True)
    dry = sum(abs(float(state.fit.values[p])) for symbol, p in numbered if symbol == "FS")
    usual = float(rows.torque[rows.mask[:, j], j].std())
    return float(each.share[j]) - 2.0 * dry * slow / (usual or 1.0) > OF_ONE["offset"].share


def _friction(each: FittedChange) -> bool:
    """True if friction changes on all joints together, where it changes on several."""
    change = each.values / each.state.fit.sigma[list(each.candidate.alternative.frictional)]
    return float(abs(change.sum())) > TOGETHER * float(np.abs(change).sum())


def _payload(each: FittedChange) -> bool:
    mass, *moments = each.values
    return float(np.linalg.norm(moments)) < ARM * abs(float(mass))


def _gravity(each: FittedChange) -> bool:
    g = np.asarray(each.state.model.robot.gravity)
    length = float(np.linalg.norm(g))
    if length == 0.0:
        return False
    return angle_between(g, g + each.values) > TILT and (
        abs(float(np.linalg.norm(g + each.values)) / length - 1.0) < STRENGTH
    )


def angle_between(a: Array, b: Array) -> float:
    """Angle between two vectors [rad]."""
    lengths = max(float(np.linalg.norm(a) * np.linalg.norm(b)), np.finfo(float).tiny)
    return float(np.arccos(np.clip(a @ b / lengths, -1.0, 1.0)))


POSSIBLE: Mapping[str, Callable[[FittedChange], bool]] = {
    "gain": _gain,
    "offset": _offset,
    "friction": _friction,
    "order": lambda each: True,
    "talk": lambda each: TALK < abs(float(each.values[0])),
    "scale": lambda each: SCALE < abs(float(each.values[1])),
    "zero": lambda each: ANGLE[0] < abs(float(each.values[0])) < ANGLE[1],
    "delay": lambda each: DELAY[0] < abs(float(each.values[0])) < DELAY[1],
    "payload": _payload,
    "gravity": _gravity,
    "balance": lambda each: each.candidate.constant < FADING,
}
"""Conditions on the values of a change, by its kind."""
