"""Rollout of the model in `armid validate`: motion that is simulated from the torque, and table of the errors."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from rich.markup import escape
from rich.table import Table

if TYPE_CHECKING:
    from armid.robot.robot import Robot
    from armid.runs.rollout import RunRollout
    from armid.runs.run import Run
    from armid.validation.rollout_score import MotionScore


def roll_out(
    run: Run,
    recordings: Sequence[str],
    reading: dict[str, Any],
    window: float,
    tolerance: float,
    controller: Path | None,
) -> RunRollout:
    """Simulate the model of a run in the windows of recordings, and print the findings on standard error."""
    from armid.cli.console import print_findings
    from armid.runs.rollout import ROLL_OUT_CODES, load_feedback, roll_out_run

    feedback = None if controller is None else load_feedback(controller)
    rollout = roll_out_run(run, recordings, reading, seconds=window, tolerance=tolerance, feedback=feedback)
    print_findings([finding for finding in rollout.findings if finding.code in ROLL_OUT_CODES])
    return rollout


def write_files(run: Run, rollout: RunRollout, out: Path | None, page: Path | None) -> list[Path]:
    """Write simulated and recorded motion to the file `out` and the page `page`, if given; return their paths."""
    from armid.runs.rollout import write_rollout

    written = [] if out is None else [write_rollout(out, rollout, run.robot.joint_names)]
    if page is not None:
        from armid.report.rollout_page import write_rollout_page

        written.append(write_rollout_page(run, rollout, page))
    return written


def check_files(out: Path | None, page: Path | None) -> None:
    """Check, before anything is simulated, that the files can be written."""
    if out is not None:
        from armid.runs.rollout import SIMULATED
        from armid.study.storage.array_files import is_archive

        is_archive(out, SIMULATED)
    if page is not None:
        from armid.report.rendering import require_extra

        require_extra()


def motion_table(robot: Robot, scores: Sequence[MotionScore], *, closed: bool) -> Table:
    """Table of the position errors of a rollout, joint by joint, averaged over the recordings."""
    from armid.notebook_display import plural

    first = scores[0]
    condition = "under the same controller" if closed else "under the recorded torque alone"
    table = Table(title=f"Position error of the simulated motion, {condition}", header_style="bold")
    for name in ("joint", "RMS", "peak", "moved", f"until {first.tolerance:g}", "CAD RMS"):
        table.add_column(name, justify="left" if name == "joint" else "right")
    for j, joint in enumerate(robot.joints):
        scale, unit = (1e3, "mm") if joint.is_prismatic else (180.0 / np.pi, "°")
        prior = [score.prior_rms[j] for score in scores if score.prior_rms is not None]
        table.add_row(
            escape(joint.name),
            _number(scale * _mean_square([score.rms[j] for score in scores]), unit),
            _number(scale * max(score.peak[j] for score in scores), unit),
            _number(scale * _mean_square([score.travelled[j] for score in scores]), unit),
            _held_time(float(np.mean([score.held[j] for score in scores])), first.seconds),
            _number(scale * _mean_square(prior), unit) if prior else "-",
        )
    count = sum(score.windows for score in scores)
    table.caption = (
        f"{plural(count, 'window')} of {first.seconds:g} s; moved: RMS distance from the position at the start of "
        "the window; until: median time until the error exceeds the tolerance in rad or m; CAD RMS: error with the "
        f"masses of the description and without friction{_missing_nominal(scores, count)}"
    )
    table.caption_justify = "left"
    return table


def _missing_nominal(scores: Sequence[MotionScore], count: int) -> str:
    """Reason why the column CAD RMS is empty, as text; empty if the column has values."""
    if all(score.prior_rms is None for score in scores):
        return "; CAD RMS is missing, because the description has no inertias"
    lost = sum(score.losses.nominal for score in scores)
    return f"; CAD RMS is missing, because this simulation diverged in {lost} of the {count} windows" if lost else ""


def _held_time(held: float, longest: float) -> str:
    """Text for the time until the error exceeds the tolerance [s]; `> window` if the error never exceeds it."""
    return f"> {longest:.2f} s" if held > 0.999 * longest else f"{held:.2f} s"


def _mean_square(values: Sequence[float]) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def _number(value: float, unit: str) -> str:
    return f"{value:.3f} {unit}" if np.isfinite(value) else "-"
