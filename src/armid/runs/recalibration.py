"""A run brought up to date by new recordings, and what has changed since."""

from __future__ import annotations

import json
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np

from armid.errors import ArmidError, Finding, StudyError
from armid.estimation.estimate import Estimate
from armid.estimation.update.recalibration import ParameterChange, recalibrate_fit
from armid.information.information import Information
from armid.measurement.recording import Recording
from armid.runs.new_recordings import NewRecordings, link_columns, load_new_recordings
from armid.runs.run import Run
from armid.study.config import EstimationChoice, RecordingChoice, Study, parse_robot, resolve_model
from armid.study.identify import Result, read_recording, score_recordings
from armid.study.plausibility import few_blocks_finding, negative_finding
from armid.study.processed import ProcessedRecording, process_each
from armid.threads import one_blas_thread
from armid.validation.prediction import Score, validate
from armid.values import digest, sha256_of_file

__all__ = ["Changed", "Recalibration", "changes_record", "recalibrate"]

Changed = Literal["friction", "tool", "all"]
"""What may have changed: friction and offsets, these and the last link, or everything."""

AGAIN = ", recalibrated"
"""Added to the name of the method: what it promised of the earlier values does not hold for the new ones."""

STILL_THE_SAME = 1.5
"""Torque error on the new recordings, over that of the earlier training, above which more has changed than asked."""


@dataclass(frozen=True, eq=False, slots=True)
class Recalibration:
    """A run brought up to date.

    Attributes:
        result: As an identification gives it, ready to be saved as a run.
        earlier: The earlier run's folder.
        changed: What was let change.
        changes: Every base parameter before and after.
        before: Torque errors of the earlier run on the recordings that judge: held out, or else the new ones.
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
    """Estimate anew what may have changed, with the earlier run for the rest.

    Args:
        run: The earlier run.
        paths: New recordings.
        reading: Fields of a reading that differ from how the run's first recording was read.
        changed: What may have changed.
        held_out: Recordings to check the result on.

    Raises:
        ArmidError: Recordings that do not fit the run, or do not show what has changed.
    """
    began = time.perf_counter()
    beside = load_new_recordings(run, paths, reading)
    tool = link_columns(run)[1] if changed == "tool" else None
    own = np.ones(beside.base.count, dtype=np.bool_) if changed == "all" else beside.changing
    if not own.any() and tool is None:
        raise StudyError(
            f"The model of {run.folder} has no friction that could have changed.", remedy="use --tool or --all."
        )
    found = recalibrate_fit(beside.earlier, run.estimate.fit, beside.new, own, tool, beside.samples)
    estimate = replace(
        run.estimate,
        method=f"{run.estimate.method.removesuffix(AGAIN)}{AGAIN}",
        fit=found.fit,
        findings=beside.findings,
        made_from=(
            f"robot {run.robot.sha256}",
            f"earlier run {sha256_of_file(Path(run.folder) / 'estimate.npz')}",
            *(f"train {each.recording.sha256}" for each in beside.recordings),
            f"options {digest(changed)}",
        ),
        made_by=beside.new.made_by,
    )
    unseen = process_each([_held_out(beside, path) for path in held_out], run.processing, run.robot)
    result = _result(beside, estimate, found.information, unseen)
    before, _ = score_recordings(run.model, run.estimate, unseen or beside.recordings)
    findings = (
        *result.estimate.findings,
        *_doubts(beside, result, changed),
        *_worse(beside, result, before, changed),
    )
    estimate = replace(result.estimate, findings=findings, seconds=time.perf_counter() - began)
    return Recalibration(replace(result, estimate=estimate), run.folder, changed, found.changes, before)


def _result(
    beside: NewRecordings,
    estimate: Estimate,
    information: Information,
    unseen: Sequence[ProcessedRecording],
) -> Result:
    """The new run: scores of the new and of held-out recordings, and the study that stands for it."""
    run = beside.run
    training, _ = score_recordings(run.model, estimate, beside.recordings)
    scores, found = score_recordings(run.model, estimate, unseen)
    validation = validate(run.robot.joint_names, scores, estimate)
    recordings = tuple(each.choice for each in (*beside.recordings, *unseen))
    study = replace(_study(run), recordings=recordings)
    # The earlier training recordings are in the estimate, too, and must not judge it; their files may be gone.
    nothing = np.full(run.robot.n, np.nan)
    known = tuple(
        Score(run.folder, sha256, nothing, nothing, nothing, nothing, nothing, None) for sha256 in run.trained_on
    )
    estimate = replace(estimate, findings=(*estimate.findings, *found))
    return Result(study, run.robot, run.model, information, estimate, validation, (*training, *known))


def _held_out(beside: NewRecordings, path: str) -> tuple[RecordingChoice, Recording]:
    """A recording to check on, which nothing has been estimated from."""
    choice = replace(beside.recordings[0].choice, path=str(Path(path).absolute()), role="validate")
    recording, _ = read_recording(choice, ".", beside.run.robot)
    if recording.sha256 in {*beside.run.trained_on, *(each.recording.sha256 for each in beside.recordings)}:
        raise StudyError(
            f"{path} is to validate, but the same data are trained on (sha256 {recording.sha256[:12]}…).",
            remedy="give a recording that neither the run nor the recalibration has seen.",
        )
    return choice, recording


def _study(run: Run) -> Study:
    """The earlier run's study: arm, model, processing and estimation."""
    path = Path(run.folder) / "study.json"
    try:
        kept: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
        return Study(
            parse_robot(kept["robot"]),
            resolve_model(run.model),
            (RecordingChoice(run.folder),),
            run.processing,
            EstimationChoice(**kept["estimation"]),
            kept["folder"],
        )
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise ArmidError(
            f"{path} is damaged or of another version ({type(error).__name__}: {error}).", remedy="identify again."
        ) from error


def _doubts(beside: NewRecordings, result: Result, changed: Changed) -> list[Finding]:
    """Return what speaks against the assumption that nothing else has changed."""
    found: list[Finding] = []
    new = np.sqrt(np.mean([score.rms**2 for score in result.training[: len(beside.recordings)]], axis=0))
    seen = np.isfinite(new)
    before = float(np.linalg.norm(beside.run.estimate.fit.residual_rms[seen]))
    error = float(np.linalg.norm(new[seen]))
    if changed != "all" and error > STILL_THE_SAME * before:
        further = "--tool or --all" if changed == "friction" else "--all"
        found.append(
            Finding(
                "more-has-changed",
                "warning",
                "",
                f"The torque error on the new recordings is {error:.3g}, the earlier run had {before:.3g}: more "
                "seems to have changed than was let change.",
                f"try {further}.",
            )
        )
    fit = result.estimate.fit
    further = (negative_finding(beside.run.model, fit), few_blocks_finding(fit))
    return [*found, *(finding for finding in further if finding is not None)]


def _worse(beside: NewRecordings, result: Result, before: Sequence[Score], changed: Changed) -> list[Finding]:
    """Held-out motion on which the earlier run is the better one, because it is of before the change or by itself."""
    scores = result.validation.recordings
    if not scores:
        return []
    error, earlier = _error(scores), _error(before)
    if not error > earlier:
        return []
    run = beside.run
    trained = float(np.sqrt(np.nansum(run.estimate.fit.residual_rms**2)))
    new = _error(score_recordings(run.model, run.estimate, beside.recordings)[0])
    if earlier <= STILL_THE_SAME * trained < new:
        return [_of_before(error, earlier, new)]
    return [
        Finding(
            "recalibration-worse",
            "warning",
            "",
            f"On validation motion the torque error is {error:.3g}, the earlier run's is {earlier:.3g}: the new "
            "values are no better than the earlier ones.",
            "record longer or wider motion"
            + (", let less change," if changed != "friction" else "")
            + " or keep the earlier run.",
        )
    ]


def _error(scores: Sequence[Score]) -> float:
    """Torque error [N·m or N]: root of the sum over joints, mean over recordings."""
    return float(np.sqrt(np.nansum(np.mean([score.rms**2 for score in scores], axis=0))))


def _of_before(error: float, earlier: float, new: float) -> Finding:
    """A check on the arm as it was: what was recalibrated cannot hold there."""
    return Finding(
        "recalibration-worse",
        "warning",
        "",
        f"On validation motion the torque error is {error:.3g}, the earlier run's is {earlier:.3g}, as in its "
        f"training, and {new:.3g} on the new recordings. The validation recording shows the arm as it was before the "
        "change, so that its verdict says nothing of the new values.",
        "validate on a recording of after the change that was not recalibrated on: --validate RECORDING.",
    )


def changes_record(recalibration: Recalibration) -> dict[str, Any]:
    """Return what has changed, as JSON."""
    base = recalibration.result.estimate.base
    units = dict(zip(base.names, base.units, strict=True))
    return {
        "earlier": recalibration.earlier,
        "let_change": recalibration.changed,
        "rms_before": [{"path": score.path, "rms": score.rms} for score in recalibration.before],
        "changes": [
            {
                "name": each.name,
                "unit": units[each.name],
                "before": each.before,
                "after": each.after,
                "change": each.change,
                "deviation": each.deviation,
                "ratio": each.ratio,
                "beyond": each.beyond,
            }
            for each in recalibration.changes
        ],
    }
