"""Torque error of an estimate on validation recordings, for each joint, and comparison with the description."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from armid.checked_array import Array, array
from armid.estimation.estimate_record import Estimate, torque_parameters
from armid.information.residuals import Comparison, compare
from armid.measurement.observations import Observations
from armid.model.dynamics_model import DynamicsModel
from armid.notebook_display import Displayed, Summary, names_apart
from armid.validation.left_out_error import LeftOutError
from armid.validation.prediction_interval import band_of_rows

CLOSE_TO_TRAINING = 3.0
"""Largest ratio of the torque error of all joints on a validation recording to that on the training motion with which
the check passes."""

SMALL_SHARE = 0.02
"""Ratio of the torque error of all joints to the standard deviation of the torque up to which the check always
passes. It is needed for noise-free data, for which the training error is nearly zero."""

COVERED_ROWS = 20_000
"""Approximate number of rows on which prediction intervals are evaluated; of a longer recording, every k-th row is
used."""


@dataclass(frozen=True, slots=True)
class Check:
    """Result of one check, on which the verdict of a validation depends.

    Attributes:
        name: Condition that is checked, as text.
        value: Value of the checked quantity.
        bound: Limit of the value.
        ok: True if the condition holds.
    """

    name: str
    value: float
    bound: float
    ok: bool


class JointCheck(Check):
    """Result of a check of a parameter of one joint."""


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
            friction, on the same rows; `None` if the description has no inertial parameters.
        offset: Mean error of the torque in the band: a constant that this recording adds to the predicted torque, for
            instance because a sensor was zeroed again [N·m or N]; empty in records of earlier versions.
        share: Share of the rows that are compared: those in which the hysteresis states are known. It is 1 without
            hysteresis; `None` if it was not stored with the run.
    """

    path: str
    sha256: str
    rms: Array
    rms_raw: Array
    spread: Array
    peak: Array
    coverage95: Array
    prior_rms: Array | None
    offset: Array = field(default_factory=lambda: np.zeros(0))
    share: Array | None = None

    def __post_init__(self) -> None:
        for name in ("rms", "rms_raw", "spread", "peak", "coverage95", "prior_rms", "offset", "share"):
            value = getattr(self, name)
            if value is not None:
                object.__setattr__(self, name, array(value, (None,), name, finite=False))

    @property
    def relative(self) -> Array:
        """RMS error divided by the standard deviation of the measured torque, shape (n,)."""
        with np.errstate(divide="ignore", invalid="ignore"):
            return self.rms / self.spread

    @property
    def rms_with_own_offset(self) -> Array:
        """RMS error without the mean error `offset` of the recording, shape (n,) [N·m or N]; NaN if it is unknown."""
        if not len(self.offset):
            return np.full(len(self.rms), np.nan)
        return np.sqrt(np.maximum(self.rms**2 - self.offset**2, 0.0))


@dataclass(frozen=True, slots=True, repr=False)
class Validation(Displayed):
    """Scores on validation recordings, and the verdict.

    Attributes:
        joints: Names of the joints.
        recordings: Torque error on each recording.
        verdict: `pass` if every check passes, `fail` if a check fails, `not judged` if no data are held out.
        checks: Checks on which the verdict depends.
        left_out: Error on training data that were left out of the estimate in turn, and the error expected on another
            recording; `None` if it is not known.
    """

    joints: tuple[str, ...]
    recordings: tuple[Score, ...]
    verdict: str
    checks: tuple[Check, ...]
    left_out: LeftOutError | None = None

    @property
    def subject(self) -> str:
        """Text that names the data to which the verdict refers."""
        if self.recordings or self.verdict == "not judged":
            return "held-out motion"
        if self.left_out is None:
            return "training motion (no motion is held out)"
        return f"left-out {self.left_out.kind} of the training data"

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
        half_widths: Half width of the 95 % prediction interval on every k-th row of all runs, M rows in total, shape
            (M, n) [N·m or N].
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

    Args:
        model: Arm and torque terms of the estimate.
        estimate: The estimate.
        observations: The processed recording.
        path: Path of the recording, for the result.
        sha256: Digest of the recording, for the result.
        prediction: Predicted torque along the recording; computed if not given.
    """
    prediction = prediction or predict_recording(model, estimate, observations)
    found = _together(prediction.runs)
    residual = np.where(found.mask, found.residual, np.nan)
    prior = model.nominal_parameters()
    prior_rms = None
    if prior is not None:
        nominal = _together([compare(model, prior, run, observations.band) for run in observations.runs])
        prior_rms = _rms(np.where(found.mask, nominal.residual, np.nan))
    rows = np.sum([run.mask.sum(axis=0) for run in observations.runs], axis=0)
    return Score(
        path,
        sha256,
        _rms(residual),
        _rms(np.where(found.mask, found.residual_raw, np.nan)),
        _of_known(np.std, np.where(found.mask, found.measured, np.nan)),
        _of_known(np.max, np.abs(residual)),
        _coverage(prediction, residual),
        prior_rms,
        _of_known(np.mean, residual),
        np.where(rows > 0, found.mask.sum(axis=0) / np.maximum(rows, 1), np.nan),
    )


def validate(
    joints: Sequence[str],
    scores: Sequence[Score],
    estimate: Estimate,
    left_out: LeftOutError | None = None,
    training: Sequence[Score] = (),
) -> Validation:
    """Checks the torque errors on validation recordings and derives the verdict.

    Without validation recordings, the errors on left-out training data are checked.

    Args:
        joints: Names of the joints.
        scores: Torque error on each validation recording.
        estimate: The estimate.
        left_out: Torque error on left-out training data, if it is known.
        training: Torque error on each training recording, for the standard deviation of the torque.
    """
    checks: list[Check] = []
    for each in scores:
        where = f" on {each.path}" if len(scores) > 1 else ""
        checks += _checks(each.rms, each.spread, each.prior_rms, estimate, where)
    if not scores and left_out is not None and training and np.isfinite(left_out.rms).any():
        spread = np.sqrt(np.mean([each.spread**2 for each in training], axis=0))
        words = f" on left-out {left_out.kind}"
        checks += _checks(left_out.rms, spread, left_out.description, estimate, words)
    if scores:
        compared = np.any([np.isfinite(each.rms) for each in scores], axis=0)
        lacking = [joint for joint, known in zip(joints, compared, strict=True) if not known]
        if lacking:
            name = f"joints without rows for validation ({', '.join(lacking)})"
            checks.append(Check(name, float(len(lacking)), 0.0, ok=False))
    verdict = "not judged" if not checks else "pass" if all(check.ok for check in checks) else "fail"
    return Validation(tuple(joints), tuple(scores), verdict, tuple(checks), left_out)


def _checks(rms: Array, spread: Array, description: Array | None, estimate: Estimate, where: str) -> list[Check]:
    """Checks of the torque errors on held-out data.

    Args:
        rms: RMS error of each joint, shape (n,) [N·m or N].
        spread: Standard deviation of the measured torque of each joint, shape (n,) [N·m or N].
        description: RMS error with the inertial parameters of the description, shape (n,) [N·m or N]; `None` if it
            has none.
        estimate: The estimate, with the errors in training.
        where: Text that is added to the names of the checks.
    """
    checks: list[Check] = []
    known = np.isfinite(rms)
    training = float(np.linalg.norm(estimate.fit.residual_rms))
    total = float(np.linalg.norm(rms[known]))
    if description is not None:
        bound = float(np.linalg.norm(description[known]))
        checks.append(Check(f"total error below the description's{where}", total, bound, total < bound))
    bound = max(CLOSE_TO_TRAINING * training, SMALL_SHARE * float(np.linalg.norm(spread[known])))
    name = f"total error within {CLOSE_TO_TRAINING:g} x training or {SMALL_SHARE:.0%} of the torque{where}"
    checks.append(Check(name, total, bound, total <= bound))
    with np.errstate(divide="ignore", invalid="ignore"):
        worst = float((rms / spread)[known].max(initial=0.0))
    checks.append(Check(f"relative RMS of every joint below 1{where}", worst, 1.0, worst < 1.0))
    return checks


def _together(parts: Sequence[Comparison]) -> Comparison:
    """Joins the comparisons of measured and predicted torque of several runs to one."""
    return Comparison(
        np.concatenate([part.measured for part in parts]),
        np.concatenate([part.predicted for part in parts]),
        np.concatenate([part.measured_raw for part in parts]),
        np.concatenate([part.predicted_raw for part in parts]),
        np.concatenate([part.mask for part in parts]),
    )


def _of_known(function: Callable[[Array], Any], values: Array) -> Array:
    """Applies a function to the values of each column that are not NaN; NaN for a column without such values."""
    columns = [column[~np.isnan(column)] for column in values.T]
    return np.array([float(function(column)) if len(column) else np.nan for column in columns])


def mean_squares(scores: Sequence[Score]) -> Array:
    """Mean over recordings of the squared RMS error of each joint, shape (n,) [(N·m)² or N²].

    A joint may have no rows in a recording, which then does not count; the mean is NaN if it has none in any.

    Args:
        scores: Torque errors of at least one recording.
    """
    squares = np.array([each.rms**2 for each in scores])
    count = np.isfinite(squares).sum(axis=0)
    return np.where(count > 0, np.nansum(squares, axis=0) / np.maximum(count, 1), np.nan)


def _rms(residual: Array) -> Array:
    """Root mean square of each column of residuals (N, n) without NaN values, shape (n,)."""
    return np.sqrt(_of_known(np.mean, residual**2))


def _coverage(prediction: PredictedRecording, residual: Array) -> Array:
    """Share of the rows of each joint whose error lies inside the 95 % prediction interval, shape (n,).

    Args:
        prediction: Predicted torque, with half widths of the interval on every k-th row.
        residual: Torque errors in the rows of all runs, NaN in masked rows, shape (N, n) [N·m or N].
    """
    ends = np.cumsum([len(run.mask) for run in prediction.runs])[:-1]
    residual = np.concatenate([part[:: prediction.every] for part in np.split(residual, ends)])
    return _of_known(np.mean, np.where(np.isnan(residual), np.nan, np.abs(residual) <= prediction.half_widths))
