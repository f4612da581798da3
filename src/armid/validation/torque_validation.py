"""Torque error of an estimate on validation recordings, for each joint, and comparison with the description."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from armid.checked_array import Array, array
from armid.estimation.estimate_record import Estimate, torque_parameters
from armid.information.residuals import Comparison, compare
from armid.measurement.observations import Observations
from armid.model.dynamics_model import DynamicsModel
from armid.notebook_display import Displayed, Summary, names_apart
from armid.validation.prediction_interval import band_of_rows

CLOSE_TO_TRAINING = 3.0
"""Largest ratio of the total error on a validation recording to the total error on the training motion that
passes."""

SMALL_SHARE = 0.02
"""Largest ratio of the error to the standard deviation of the torque that always passes. It is needed for noise-free
data, for which the training error is nearly zero."""

COVERED_ROWS = 20_000
"""Approximate number of rows on which prediction intervals are evaluated; of a longer recording, every k-th row is
used."""


@dataclass(frozen=True, slots=True)
class Check:
    """Condition of the verdict.

    Attributes:
        name: Name of the condition.
        value: Value of the checked quantity.
        bound: Largest value that passes.
        ok: True if the condition holds.
    """

    name: str
    value: float
    bound: float
    ok: bool


class JointCheck(Check):
    """Condition for a parameter of one joint."""


@dataclass(frozen=True, eq=False, slots=True)
class Score:
    """Torque error on one recording, for each joint, shape (n,); NaN for a joint of which no row is in use.

    Attributes:
        path: Path of the recording.
        sha256: Digest of the recording.
        rms: RMS error of the torque in the band of the study [N·m or N].
        rms_raw: RMS error of the unfiltered torque [N·m or N].
        spread: Standard deviation of the measured torque in the band [N·m or N].
        peak: Largest absolute error in the band [N·m or N].
        coverage95: Share of rows inside the 95 % prediction interval.
        prior_rms: RMS error of the torque in the band with the inertial parameters of the description and without
            friction; `None` if the description has no inertial parameters.
    """

    path: str
    sha256: str
    rms: Array
    rms_raw: Array
    spread: Array
    peak: Array
    coverage95: Array
    prior_rms: Array | None

    def __post_init__(self) -> None:
        for name in ("rms", "rms_raw", "spread", "peak", "coverage95", "prior_rms"):
            value = getattr(self, name)
            if value is not None:
                object.__setattr__(self, name, array(value, (None,), name, finite=False))

    @property
    def relative(self) -> Array:
        """RMS error divided by the standard deviation of the measured torque, shape (n,)."""
        with np.errstate(divide="ignore", invalid="ignore"):
            return self.rms / self.spread


@dataclass(frozen=True, slots=True, repr=False)
class Validation(Displayed):
    """Scores on validation recordings, and the verdict.

    Attributes:
        joints: Names of the joints.
        recordings: Torque error on each recording.
        verdict: `pass` if every check holds, `fail` if a check does not hold, `not judged` without validation
            recordings.
        checks: Conditions of the verdict.
    """

    joints: tuple[str, ...]
    recordings: tuple[Score, ...]
    verdict: str
    checks: tuple[Check, ...]

    @property
    def subject(self) -> str:
        """Name of the motion to which the verdict refers: training motion if no motion is held out."""
        on_training = not self.recordings and self.verdict != "not judged"
        return "training motion (no motion is held out)" if on_training else "held-out motion"

    def summary(self) -> Summary:
        """Table of the torque error of every joint on each recording."""
        names = names_apart(each.path for each in self.recordings)
        columns = ("joint", *(f"{names[each.path]}, RMS" for each in self.recordings))
        rows = tuple(
            (joint, *(f"{each.rms[j]:.4g}" for each in self.recordings)) for j, joint in enumerate(self.joints)
        )
        failed = ", ".join(check.name for check in self.checks if not check.ok)
        note = f"not fulfilled: {failed}" if failed else "N·m or N, in the band of the study"
        return Summary(f"verdict on {self.subject}: {self.verdict}", columns, rows, note)


@dataclass(frozen=True, eq=False, slots=True)
class PredictedRecording:
    """Torque that an estimate predicts along one recording, with prediction intervals.

    Attributes:
        runs: Measured and predicted torque of each contiguous run.
        every: Number k: intervals are computed for every k-th row of a run.
        half_widths: Half width of the 95 % prediction interval on these M rows of all runs, shape (M, n) [N·m or N].
    """

    runs: tuple[Comparison, ...]
    every: int
    half_widths: Array


def predict_recording(model: DynamicsModel, estimate: Estimate, observations: Observations) -> PredictedRecording:
    """Predicts the torque along a recording, with prediction intervals on some ten thousand rows."""
    theta = torque_parameters(estimate.base, estimate.fit)
    runs = tuple(compare(model, theta, run, observations.band) for run in observations.runs)
    every = max(1, sum(len(run.rows) for run in observations.runs) // COVERED_ROWS)
    return PredictedRecording(runs, every, band_of_rows(model, estimate, observations, every))


def score(
    model: DynamicsModel,
    estimate: Estimate,
    observations: Observations,
    *,
    path: str = "",
    sha256: str = "",
    prediction: PredictedRecording | None = None,
) -> Score:
    """Compares the torque of an estimate with the measured torque of a recording.

    If `prediction` is not given, it is computed.
    """
    prediction = prediction or predict_recording(model, estimate, observations)
    found = _together(prediction.runs)
    residual = np.where(found.mask, found.residual, np.nan)
    prior = model.nominal_parameters()
    prior_rms = None
    if prior is not None:
        nominal = _together([compare(model, prior, run, observations.band) for run in observations.runs])
        prior_rms = _rms(np.where(nominal.mask, nominal.residual, np.nan))
    return Score(
        path,
        sha256,
        _rms(residual),
        _rms(np.where(found.mask, found.residual_raw, np.nan)),
        _of_known(np.std, np.where(found.mask, found.measured, np.nan)),
        _of_known(np.max, np.abs(residual)),
        _coverage(prediction, residual),
        prior_rms,
    )


def validate(joints: Sequence[str], scores: Sequence[Score], estimate: Estimate) -> Validation:
    """Checks the torque errors on validation recordings and derives the verdict."""
    checks: list[Check] = []
    training = float(np.linalg.norm(estimate.fit.residual_rms))
    for each in scores:
        known = np.isfinite(each.rms)
        total = float(np.linalg.norm(each.rms[known]))
        where = f" on {each.path}" if len(scores) > 1 else ""
        if each.prior_rms is not None:
            bound = float(np.linalg.norm(each.prior_rms[known]))
            checks.append(Check(f"total error below the description's{where}", total, bound, total < bound))
        spread = float(np.linalg.norm(each.spread[known]))
        bound = max(CLOSE_TO_TRAINING * training, SMALL_SHARE * spread)
        name = f"total error within {CLOSE_TO_TRAINING:g} x training or {SMALL_SHARE:.0%} of the torque{where}"
        checks.append(Check(name, total, bound, total <= bound))
        worst = float(each.relative[known].max(initial=0.0))
        checks.append(Check(f"relative RMS of every joint below 1{where}", worst, 1.0, worst < 1.0))
    if scores:
        compared = np.any([np.isfinite(each.rms) for each in scores], axis=0)
        lacking = [joint for joint, known in zip(joints, compared, strict=True) if not known]
        if lacking:
            name = f"joints without rows for validation ({', '.join(lacking)})"
            checks.append(Check(name, float(len(lacking)), 0.0, ok=False))
    verdict = "not judged" if not scores else "pass" if all(check.ok for check in checks) else "fail"
    return Validation(tuple(joints), tuple(scores), verdict, tuple(checks))


def _together(parts: Sequence[Comparison]) -> Comparison:
    """Comparison of several runs, concatenated."""
    return Comparison(
        np.concatenate([part.measured for part in parts]),
        np.concatenate([part.predicted for part in parts]),
        np.concatenate([part.measured_raw for part in parts]),
        np.concatenate([part.predicted_raw for part in parts]),
        np.concatenate([part.mask for part in parts]),
    )


def _of_known(function: Callable[[Array], Any], values: Array) -> Array:
    """Function of those values of each column that are not NaN; NaN for a column that has only NaN."""
    columns = [column[~np.isnan(column)] for column in values.T]
    return np.array([float(function(column)) if len(column) else np.nan for column in columns])


def _rms(residual: Array) -> Array:
    """Root mean square of each column, in which NaN is ignored."""
    return np.sqrt(_of_known(np.mean, residual**2))


def _coverage(prediction: PredictedRecording, residual: Array) -> Array:
    """Share of the rows of each joint whose error lies inside the 95 % prediction interval, shape (n,)."""
    ends = np.cumsum([len(run.mask) for run in prediction.runs])[:-1]
    residual = np.concatenate([part[:: prediction.every] for part in np.split(residual, ends)])
    return _of_known(np.mean, np.where(np.isnan(residual), np.nan, np.abs(residual) <= prediction.half_widths))
