"""Effect of systematic errors on an estimate: covariance, shift, and findings about errors that matter.

The prior of m errors e is known by their standard deviations. The residuals are a second source. Let S be the
sensitivity of the estimate to e, and F the information of the residuals about e
(`armid.estimation.uncertainty.systematic.systematic_errors`). Both sources together give the errors with the mean ê
and the covariance C. The estimate is not corrected, so its error is S e; the covariance of the estimate contains

    S C Sᵀ + ρ² (S ê)(S ê)ᵀ.

with ρ = `SHARE`. The second part contains the signs of the errors: a delay of all joints shifts the estimate along
one direction, and not along one direction for each joint. If the data show that there is no error, both parts vanish.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass, field, replace

import numpy as np

from armid.checked_array import Array
from armid.errors import Finding
from armid.estimation.standard_parameter_resolution import ConeShift
from armid.estimation.uncertainty.systematic.systematic_errors import ErrorKind, ErrorProducts
from armid.remedy import Remedy, setting
from armid.robot import Robot

SHARE = 0.75
"""Share ρ of the shift by systematic errors that counts as one standard deviation. If the shift is far above the
noise, a 95 % interval then extends by 1.5 times the shift. If the shift is 1.5 standard deviations of the noise, the
coverage is 93 %; with a share of 0.65 it would be 89 %."""

STEPS = 3
"""Number of passes. Each pass estimates first the correlation of the residuals without the errors found so far, then
the errors. The first pass counts the errors as correlated noise; passes after the third would change standard
deviations by less than a tenth."""

FEWEST_PARTS = 4
"""Smallest number of parts of the recordings from which the correlation of the residuals is estimated."""


@dataclass(frozen=True, eq=False, slots=True)
class ErrorEffect:
    """Systematic errors, estimated from the residuals and their prior, and their effect on an estimate of b unknowns.

    Attributes:
        kinds: The m errors.
        values: Expected values of the errors, shape (m,), in the unit of each error [s, rad or m, N·m or N].
        deviations: Standard deviations of the errors, shape (m,), in the same units.
        sensitivity: Change of the estimate by one unit of each error, shape (b, m).
        covariance: Covariance of the estimate that the errors cause, shape (b, b).
        attenuation: Shift of the estimate by noise in the regressor that counts as one standard deviation, shape
            (b,).
    """

    kinds: tuple[ErrorKind, ...] = ()
    values: Array = field(default_factory=lambda: np.zeros(0))
    deviations: Array = field(default_factory=lambda: np.zeros(0))
    sensitivity: Array = field(default_factory=lambda: np.zeros((0, 0)))
    covariance: Array = field(default_factory=lambda: np.zeros((0, 0)))
    attenuation: Array = field(default_factory=lambda: np.zeros(0))


def effect_of_errors(
    products: ErrorProducts, inverse: Array, prior: Array, *, further: Array | float = 0.0
) -> ErrorEffect:
    """Computes the effect of systematic errors on an estimate.

    Args:
        products: Products of the columns of the errors with rows and residuals.
        inverse: Inverse of the weighted normal matrix, prior included, shape (b, b).
        prior: Precision of the prior, shape (b, b).
        further: Shift of the estimate by another cause, which is added to the shift by the errors, shape (b,).
    """
    size = np.array([kind.deviation for kind in products.kinds])
    pulls, scores = products.pulls * size, products.scores * size
    S = inverse @ pulls.sum(axis=0)
    normals = products.normals * np.outer(size, size)
    # What the errors change in the scores of each part, with the parameters moved by them. As a sum of squares, the
    # information is positive even where the inverse belongs to rows with other weights.
    changes = normals - pulls.transpose(0, 2, 1) @ S - S.T @ pulls + S.T @ products.rows @ S
    F = changes.sum(axis=0) + S.T @ prior @ S
    found, C = np.zeros(len(size)), np.eye(len(size))
    for _ in range(STEPS):  # an error that is not yet known looks like correlated noise
        correlation = _correlation(scores - products.row_scores @ S - changes @ found, np.diag(F))
        half = 1.0 / np.sqrt(correlation)
        C = np.linalg.inv(half[:, None] * F * half + np.eye(len(size)))
        found = C @ (scores.sum(axis=0) / correlation)
    shift = S @ found + further
    covariance = S @ C @ S.T + SHARE**2 * np.outer(shift, shift)
    return ErrorEffect(
        products.kinds, size * found, size * np.sqrt(np.diag(C)), S / size, 0.5 * (covariance + covariance.T)
    )


@dataclass(frozen=True, eq=False, slots=True)
class ConeEffect:
    """Effect of the cone of consistent bodies on an estimate of b unknowns.

    Attributes:
        prior: Precision of prior and cone, shape (b, b).
        shift: Precision of the prior alone, and shift by the cone.
        without: Inverse of the weighted normal matrix with the prior alone, shape (b, b).
        correlation: Number of rows that count as one independent sample.
    """

    prior: Array
    shift: ConeShift
    without: Array
    correlation: float

    @property
    def contradicted(self) -> float:
        """Share of the squared shift by the cone that noise does not explain, from 0 to 1."""
        shift = self.shift.shift
        size = float(shift @ np.linalg.solve(self.without, shift)) / self.correlation
        inverse = np.linalg.inv(np.linalg.inv(self.without) + self.prior - self.shift.precision)
        expected = float(np.sum(inverse * (self.prior - self.shift.precision)))
        return max(0.0, 1.0 - max(expected, 0.0) / size) if size > 0.0 else 0.0


def effect_with_cone(effect: ErrorEffect, products: ErrorProducts, cone: ConeEffect) -> ErrorEffect:
    """Effect of systematic errors on an estimate that the cone of consistent bodies restricts.

    If noise explains the shift by the cone, the cone also reduces the effect of systematic errors, as a prior does.
    If the cone contradicts the data, systematic errors are the cause: the error of the estimate is then the effect of
    the errors on the estimate without the cone plus the shift by the cone. Between these cases, the two covariances
    are averaged with the weight `contradicted`.

    Args:
        effect: Effect on the estimate with prior and cone.
        products: Products of the columns of the errors with rows and residuals.
        cone: Effect of the cone on the estimate.
    """
    share = cone.contradicted
    if share == 0.0:
        return effect
    moved = effect_of_errors(products, cone.without, cone.shift.precision, further=cone.shift.shift)
    return replace(effect, covariance=(1.0 - share) * effect.covariance + share * moved.covariance)


def _correlation(scores: Array, information: Array) -> Array:
    """Number of rows that count as one independent row for each error, at least 1, shape (m,).

    Args:
        scores: Products of the errors' columns with the residuals in each part of the time, without the effect of the
            parameters, shape (parts, m).
        information: Information of independent rows about each error, shape (m,).
    """
    used = np.any(scores != 0.0, axis=1)
    if used.sum() < FEWEST_PARTS:
        return np.ones(len(information))
    scatter = np.sum(scores[used] ** 2, axis=0)
    return np.maximum(np.divide(scatter, information, out=np.ones_like(scatter), where=information > 0.0), 1.0)


def error_findings(effect: ErrorEffect, scatter: Array, names: tuple[str, ...], robot: Robot) -> list[Finding]:
    """Findings about systematic errors that are significant and shift a parameter by more than its noise.

    Args:
        effect: The errors and their effect.
        scatter: Covariance of the estimate by the noise of the data, shape (b, b).
        names: Names of the b parameters.
        robot: The arm.
    """
    deviation = np.sqrt(np.maximum(np.diag(scatter), 0.0))
    findings: list[Finding] = []
    for name, message in MESSAGES.items():
        groups = [own for own in _groups(effect, name) if _size(effect, own)[0] > SURE * _size(effect, own)[1]]
        sure = list(itertools.chain.from_iterable(groups))
        shift = effect.sensitivity[:, sure] @ effect.values[sure]
        ratio = np.divide(np.abs(shift), deviation, out=np.zeros_like(shift), where=deviation > 0.0)
        if not len(sure) or ratio.max() < MATTERS:
            continue
        most = int(np.argmax(ratio))
        listed = ", ".join(_stated(effect, own, robot) for own in groups)
        evidence = (
            f"{message.found} {listed}. This shifts {names[most]} by {ratio[most]:.1f} standard deviations of its "
            "noise, and other parameters less. The intervals are widened by this shift; the values are not corrected."
        )
        remedy = message.remedy
        if name == "ripple":
            remedy = _with_term([effect.kinds[own[0]] for own in groups], robot)
        findings.append(Finding(message.code, "warning", "", evidence, remedy))
    return findings


def _with_term(kinds: list[ErrorKind], robot: Robot) -> Remedy:
    """Remedy of a finding: add ripple with the found numbers of waves, rounded to halves, to the model."""
    harmonics = sorted({round(2.0 * kind.waves) / 2.0 for kind in kinds})
    joints = [robot.joints[j].name for j in sorted({kind.joint for kind in kinds})]
    return Remedy(
        "add the term `ripple`, with ", setting("harmonics", harmonics), " and ", setting("joints", joints),
        " in [model.ripple].",
    )  # fmt: skip


def _groups(effect: ErrorEffect, name: str) -> list[list[int]]:
    """Indices of the errors with a given name, in groups: sine and cosine of a ripple form one group."""
    groups: dict[tuple[int, float], list[int]] = {}
    for k, kind in enumerate(effect.kinds):
        if kind.name == name:
            groups.setdefault((kind.joint, kind.waves), []).append(k)
    return list(groups.values())


def _size(effect: ErrorEffect, own: list[int]) -> tuple[float, float]:
    """Absolute value of an error and its standard deviation; for a ripple, its amplitude.

    Args:
        effect: The errors and their effect.
        own: Indices of the error: one, or two for the sine and cosine of a ripple.
    """
    return float(np.linalg.norm(effect.values[own])), float(np.sqrt(np.mean(effect.deviations[own] ** 2)))


def _stated(effect: ErrorEffect, own: list[int], robot: Robot) -> str:
    """Text with the name of the joint, the value of the error, its standard deviation and the unit."""
    kind, (size, deviation) = effect.kinds[own[0]], _size(effect, own)
    joint = robot.joints[kind.joint]
    if kind.name == "ripple":
        return f"{joint.name} {size:.3g} ± {deviation:.2g} {joint.effort_unit} with {kind.waves:.3g} waves in a turn"
    factor, unit = {"delay": (1e3, "ms"), "zero": (1.0, joint.unit), "rise": (1.0, joint.effort_unit)}[kind.name]
    return f"{joint.name} {factor * effect.values[own[0]]:.3g} ± {factor * deviation:.2g} {unit}"


@dataclass(frozen=True, slots=True)
class _Message:
    """Texts of a finding about one kind of systematic error: code, evidence and remedy."""

    code: str
    found: str
    remedy: str


SURE = 5.0
"""Number of standard deviations by which an error must differ from zero to be reported. With three errors for each
joint, chance causes less than one report in 700 recordings of an arm with seven joints."""

MATTERS = 1.0
"""Smallest shift of the most affected parameter with which errors are reported, in standard deviations by noise. A
shift of one standard deviation lowers the coverage of a 95 % interval to 83 %."""

MESSAGES = {
    "delay": _Message(
        "timing-error",
        "The torque is later than the positions (earlier if negative):",
        "add these delays in seconds to the key `delay` of the recordings, if a delay or a filter of the drive is "
        'the cause; friction that the model lacks can look like a delay, too (`terms = "auto"`).',
    ),
    "zero": _Message(
        "zero-error",
        "The logged positions are larger than the angles that the torques show (smaller if negative):",
        "calibrate the zeros of the encoders, or subtract these values from the key `joint_offset` of the "
        "recordings.",
    ),
    "rise": _Message(
        "friction-rise",
        "Friction near rest is larger than the model's (smaller if negative):",
        'let friction be selected with `terms = "auto"`, or add the term `stribeck`.',
    ),
    "ripple": _Message("torque-ripple", "The residuals repeat with the angle of joints, with these amplitudes:", ""),
}
"""Texts of the findings about each kind of systematic error, by the name of the kind."""
