"""Recalibration of a run with new recordings, and the changes of its parameters."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from armid.doctor.rows_away_from_reversals import rows_near_reversals
from armid.errors import EstimationError, Finding, StudyError
from armid.estimation.estimate_record import EARLIER_RUN, Estimate, InputDigest
from armid.estimation.update.parameter_change import ParameterChange
from armid.estimation.update.recalibration import recalibrate_fit
from armid.estimation.whitened_system import minimum_norm_solution
from armid.hashes import digest, sha256_of_file
from armid.information.accumulate import accumulate_information
from armid.information.information import Information, stack, total
from armid.runs.new_recordings import NewRecordings, link_columns, load_new_recordings
from armid.runs.read_records import study_of_run
from armid.runs.run import Run
from armid.study.diagnosis import diagnosed_error
from armid.study.identify import Result
from armid.study.plausibility.estimate_findings import few_blocks_finding, negative_finding
from armid.study.plausibility.recording_errors import contradicted
from armid.study.recordings.processed import ProcessedRecording, joined_observations
from armid.study.score_recordings import score_recordings
from armid.threads import one_blas_thread
from armid.validation.torque_validation import Score, mean_squares, validate

Changed = Literal["friction", "tool", "all"]
"""Set of the parameters that may have changed: `friction` (friction and offsets), `tool` (friction, offsets and the
last link) or `all`."""

RECALIBRATED = ", recalibrated"
"""Suffix of the name of the estimator in a recalibrated run. The suffix shows that the values do not have the
properties of this estimator, for instance physical consistency."""

LEAST_ROWS = 2
"""Smallest number of rows of a joint, divided by the number of base parameters, with which the torque error without
rows near reversals and rests is computed."""

SAME_ERROR = 1.5
"""Ratio of the torque error on the new recordings to the training error of the earlier run above which parameters
that were not estimated again must have changed."""


@dataclass(frozen=True, eq=False, slots=True)
class Recalibration:
    """Recalibrated run.

    Attributes:
        result: Result in the form of an identification, which can be saved as a run.
        earlier: Folder of the earlier run.
        changed: Set of the parameters that were estimated again.
        changes: Value of every base parameter before and after the recalibration.
        before: Torque errors of the earlier run on the validation recordings, or, if there are none, on the new
            recordings.
    """

    result: Result
    earlier: str
    changed: Changed
    changes: tuple[ParameterChange, ...]
    before: tuple[Score, ...]


@one_blas_thread
def recalibrate(
    run: Run,
    paths: Sequence[str],
    reading: Mapping[str, Any],
    *,
    changed: Changed = "friction",
    held_out: Sequence[str] = (),
) -> Recalibration:
    """Estimates the parameters that may have changed; the other parameters are taken from the earlier run.

    Args:
        run: The earlier run.
        paths: New recordings.
        reading: Fields of the log format that differ from that of the run's first recording.
        changed: Set of the parameters that may have changed.
        held_out: Recordings for validation.

    Raises:
        ArmidError: The recordings do not fit the run, or do not determine the parameters.
    """
    began = time.perf_counter()
    new_recordings = load_new_recordings(run, paths, reading, held_out=held_out)
    tool = link_columns(run)[1] if changed == "tool" else None
    own = np.ones(new_recordings.base.count, dtype=np.bool_) if changed == "all" else new_recordings.changing
    if not own.any() and tool is None:
        raise StudyError(
            f"By default only friction is estimated again, but the model of {run.folder} has no friction.",
            remedy="use --tool if the tool has changed, or --all to estimate all parameters again.",
        )
    try:
        found = recalibrate_fit(
            new_recordings.earlier, run.estimate.fit, new_recordings.new, own, tool, new_recordings.samples
        )
    except EstimationError as error:
        raise diagnosed_error(error, new_recordings.findings) from error
    unseen = new_recordings.held_out
    again = any(each.role == "earlier run" for each in run.estimate.made_from)
    estimate = replace(
        run.estimate,
        method=run.estimate.method if again else f"{run.estimate.method}{RECALIBRATED}",
        fit=found.fit,
        findings=new_recordings.findings,
        made_from=(
            InputDigest("robot", run.robot.sha256),
            InputDigest(EARLIER_RUN, sha256_of_file(Path(run.folder) / "estimate.npz")),
            *(InputDigest("train", each.recording.sha256) for each in new_recordings.recordings),
            *(InputDigest("validate", each.recording.sha256) for each in unseen),
            InputDigest("options", digest(changed)),
        ),
        made_by=new_recordings.new.made_by,
    )
    result = _result(new_recordings, estimate, found.information, unseen)
    before, _ = score_recordings(run.model, run.estimate, unseen or new_recordings.recordings)
    findings = (
        *result.estimate.findings,
        *_assumption_findings(new_recordings, result, changed),
        *_regression_findings(new_recordings, result, before, changed),
    )
    estimate = replace(result.estimate, findings=findings, seconds=time.perf_counter() - began)
    return Recalibration(replace(result, estimate=estimate), run.folder, changed, found.changes, before)


def _result(
    new_recordings: NewRecordings,
    estimate: Estimate,
    information: Information,
    unseen: Sequence[ProcessedRecording],
) -> Result:
    """Makes the result of a recalibration, with its study and its errors on new and on validation recordings.

    Args:
        new_recordings: The new recordings and the earlier run.
        estimate: The new estimate.
        information: Factors whose least-squares solution is the new estimate.
        unseen: Validation recordings, processed.
    """
    run = new_recordings.run
    training, _ = score_recordings(run.model, estimate, new_recordings.recordings)
    scores, found = score_recordings(run.model, estimate, unseen)
    validation = contradicted(validate(run.robot.joint_names, scores, estimate), new_recordings.findings)
    recordings = tuple(each.choice for each in (*new_recordings.recordings, *unseen))
    study = replace(study_of_run(run), recordings=recordings)
    # The earlier training recordings took part in the estimate and must not validate it; their files may be missing.
    nothing = np.full(run.robot.n, np.nan)
    known = tuple(
        Score(run.folder, sha256, nothing, nothing, nothing, nothing, nothing, None) for sha256 in run.trained_on
    )
    estimate = replace(estimate, findings=(*estimate.findings, *found))
    return Result(study, run.robot, run.model, information, estimate, validation, (*training, *known))


def _assumption_findings(new_recordings: NewRecordings, result: Result, changed: Changed) -> list[Finding]:
    """Findings if the data contradict the assumption that only the parameters that are estimated again have changed.

    Args:
        new_recordings: The new recordings and the earlier run.
        result: Result of the recalibration.
        changed: Set of the parameters that were estimated again.
    """
    found: list[Finding] = []
    new = np.sqrt(mean_squares(result.training[: len(new_recordings.recordings)]))
    seen = np.isfinite(new)
    before = float(np.linalg.norm(new_recordings.run.estimate.fit.residual_rms[seen]))
    error = float(np.linalg.norm(new[seen]))
    larger = changed != "all" and error > SAME_ERROR * before
    faults = new_recordings.faults
    least = _least_error(new_recordings.new, seen) if larger and not faults else 0.0
    if larger and error <= SAME_ERROR * least:
        found.append(_unexplained(new_recordings, seen, before, error, least))
    elif larger:
        unit = _effort_unit(new_recordings.run)
        further = "--tool or --all" if changed == "friction" else "--all"
        found.append(
            Finding(
                "more-has-changed",
                "warning",
                "",
                f"The torque error on the new recordings is {error:.3g} {unit}, but was {before:.3g} {unit} in the "
                "earlier run, so parameters that were not estimated again seem to have changed"
                + (", or the recordings have a fault." if faults else "."),
                f"first correct {', '.join(faults)} (findings above); estimating more parameters only hides it."
                if faults
                else f"estimate more parameters with {further}.",
            )
        )
    fit = result.estimate.fit
    further = (negative_finding(new_recordings.run.model, fit), few_blocks_finding(fit))
    return [*found, *(finding for finding in further if finding is not None)]


def _unexplained(
    new_recordings: NewRecordings, seen: NDArray[np.bool_], before: float, error: float, least: float
) -> Finding:
    """Finding about a torque error that no values of the parameters explain, with the cause if it is known.

    Args:
        new_recordings: The new recordings.
        seen: Mask of the joints with rows in use.
        before: Torque error of the earlier run in training [N·m or N].
        error: Torque error on the new recordings [N·m or N].
        least: Torque error on the new recordings if all parameters are estimated from them [N·m or N].
    """
    moving, unit = _least_error_in_motion(new_recordings, seen), _effort_unit(new_recordings.run)
    text = (
        f"The torque error on the new recordings is {error:.3g} {unit}, but was {before:.3g} {unit} in the earlier "
        f"run; if all parameters are estimated, it is still {least:.3g} {unit}"
    )
    unchanged = "This does not show that other parameters have changed."
    if moving <= SAME_ERROR * before:
        text += (
            f", but {moving:.3g} {unit} without the rows in which a joint is slow, reverses or rests. Friction at "
            f"rest and at reversals, which the model lacks, has a larger share in these recordings. {unchanged}"
        )
        remedy = "record without rests, or leave out rests (key `exclude`); both errors are then comparable."
        return Finding("noisier-recordings", "info", "", text, remedy)
    text += (
        ". The cause is larger noise in the band, for instance because of a lower rate or fewer periods, or an "
        f"effect that the model lacks; the check cannot tell which. {unchanged}"
    )
    return Finding("noisier-recordings", "info", "", text)


def _least_error_in_motion(new_recordings: NewRecordings, seen: NDArray[np.bool_]) -> float:
    """Smallest possible torque error on the new recordings, without rows near reversals and rests [N·m or N].

    It is computed as in `_least_error`; the result is infinite if too few rows remain.

    Args:
        new_recordings: The new recordings.
        seen: Mask of the joints over which the error is summed, shape (n,).
    """
    run, observed = new_recordings.run, joined_observations(new_recordings.recordings)
    cutoff = np.inf if observed.band.is_open else observed.band.cutoff
    near = rows_near_reversals(observed.runs, cutoff)
    moving = [replace(each, mask=each.mask & ~rows) for each, rows in zip(observed.runs, near, strict=True)]
    kept = np.sum([each.mask.sum(axis=0) for each in moving], axis=0)
    if (kept[seen] <= LEAST_ROWS * new_recordings.base.count).any():
        return np.inf
    information = accumulate_information(run.model, new_recordings.base, replace(observed, runs=tuple(moving)))
    return _least_error(information, seen)


def _least_error(new: Information, seen: NDArray[np.bool_]) -> float:
    """Torque error if all parameters are estimated from the new recordings alone [N·m or N].

    It is the root of the sum of the joints' squared RMS errors.

    Args:
        new: Factors of the new recordings.
        seen: Mask of the joints over which the error is summed, shape (n,).
    """
    whole = total(new)
    values = minimum_norm_solution(*stack(whole))[0]
    rows = np.maximum(whole.rows.sum(axis=0), 1)
    squares = [np.sum((each.R[0, :, -1] - each.R[0, :, :-1] @ values[each.parameters]) ** 2) for each in whole.joints]
    return float(np.sqrt(np.sum((np.array(squares) / rows)[seen])))


def _regression_findings(
    new_recordings: NewRecordings, result: Result, before: Sequence[Score], changed: Changed
) -> list[Finding]:
    """Finding that the earlier values give smaller torque errors on held-out motion than the new values.

    The list is empty if the new values are better, or if there is no held-out motion.
    """
    scores = result.validation.recordings
    if not scores:
        return []
    error, earlier = _error(scores), _error(before)
    if not error > earlier:
        return []
    run, unit = new_recordings.run, _effort_unit(new_recordings.run)
    trained = float(np.sqrt(np.nansum(run.estimate.fit.residual_rms**2)))
    new = _error(score_recordings(run.model, run.estimate, new_recordings.recordings)[0])
    if earlier <= SAME_ERROR * trained < new:
        return [_older_validation(error, earlier, new, unit)]
    return [
        Finding(
            "recalibration-worse",
            "warning",
            "",
            f"On validation motion the torque error is {error:.3g} {unit} with the new values and {earlier:.3g} "
            f"{unit} with the earlier values, so the new values are not better.",
            "record a longer motion or one with larger amplitudes"
            + (", estimate fewer parameters again," if changed != "friction" else "")
            + " or keep the earlier run.",
        )
    ]


def _effort_unit(run: Run) -> str:
    """Unit of the torque errors of a run: `N·m`, or `N·m or N` for an arm that also has prismatic joints."""
    return " or ".join(dict.fromkeys(joint.effort_unit for joint in run.robot.joints))


def _error(scores: Sequence[Score]) -> float:
    """Torque error [N·m or N]: root of the sum over joints of squared RMS errors, averaged over the recordings."""
    return float(np.sqrt(np.nansum(mean_squares(scores))))


def _older_validation(error: float, earlier: float, new: float, unit: str) -> Finding:
    """Finding that the validation recording was probably made before the arm changed.

    Args:
        error: Torque error on the validation recording with the new values.
        earlier: Torque error on the validation recording with the earlier values.
        new: Torque error on the new recordings with the earlier values.
        unit: Unit of the errors.
    """
    return Finding(
        "recalibration-worse",
        "warning",
        "",
        f"On the validation recording, the torque error is {earlier:.3g} {unit} with the earlier values, about the "
        f"same as in their training, and {error:.3g} {unit} with the new values; on the new recordings, it is "
        f"{new:.3g} {unit} with the earlier values. The validation recording was therefore probably made before the "
        "change, and the verdict does not apply to the new values.",
        "validate on another recording that was made after the change: --validate RECORDING.",
    )
