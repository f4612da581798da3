"""Page of a rollout: recorded and simulated motion and torque of each joint."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np

from armid.checked_array import Array
from armid.notebook_display import names_apart, plural
from armid.report.data.joint_names import heading_of, label_of
from armid.report.data.number_format import short
from armid.report.page import assemble
from armid.report.page_file import write_html
from armid.report.plots.plot_specification import Axes, Plot, line
from armid.report.rendering import require_extra
from armid.report.section import Section, one_of
from armid.report.tables import Column, Table, TableCell
from armid.robot import Joint
from armid.runs.rollout import RunRollout
from armid.runs.run import Run
from armid.validation.rollout_score import MotionScore
from armid.validation.simulated_windows import SimulatedWindows

MILLI = 1e3
"""Factor by which position errors [rad or m] are multiplied, to show them in mrad or mm."""


def write_rollout_page(run: Run, rollout: RunRollout, path: Path | str) -> Path:
    """Writes a page that compares recorded and simulated motion and torque.

    Args:
        run: The run.
        rollout: Rollout of the model of the run.
        path: The file; it is written completely or not at all.

    Raises:
        MissingExtraError: jinja2 or plotly is not installed.
        OutputError: The file is not an HTML page, or cannot be written.
    """
    require_extra()
    first = rollout.scores[0]
    windows = sum(score.windows for score in rollout.scores)
    subtitle = f"{run.folder}: {plural(windows, 'window')} of {first.seconds:g} s"
    sections = {name: show(run.robot.joints, rollout) for name, show in ROLLOUT.items()}
    return write_html(path, assemble(f"{run.robot.name}: simulated motion", subtitle, sections, with_plots=True))


def rollout_section(joints: tuple[Joint, ...], rollout: RunRollout) -> Section:
    """Section with the errors of each joint, and plots of position, position error and torque of each recording."""
    names = names_apart(score.path for score in rollout.scores)
    tables = tuple(
        _table(joints, number, names[score.path], score, simulated)
        for number, (score, simulated) in enumerate(zip(rollout.scores, rollout.simulated, strict=True), 1)
    )
    rows = tuple(
        (f"{names[score.path]}: {heading_of(joints, j)}", _plots(joints[j], number, j, simulated))
        for number, (score, simulated) in enumerate(zip(rollout.scores, rollout.simulated, strict=True), 1)
        for j in range(len(joints))
    )
    content = {"closed": rollout.closed, "lost": sum(score.lost for score in rollout.scores)}
    legend = (("measured", "recorded, in the study's band"), ("predicted", "simulated"), ("training", "error"))
    return Section("Motion and torque, recorded and simulated", content, tables, rows, legend)


def _table(
    joints: tuple[Joint, ...], number: int, name: str, score: MotionScore, simulated: SimulatedWindows
) -> Table:
    """Table of the errors of each joint on one recording."""
    unit, effort = one_of([joint.unit for joint in joints]), one_of([joint.effort_unit for joint in joints])
    stayed = simulated.found.stayed
    small = one_of([f"m{joint.unit}" for joint in joints])
    velocity, torque = (
        _rms((getattr(simulated.found, each) - getattr(simulated.windows, each))[stayed]) for each in ("dq", "torque")
    )
    columns = (
        Column("joint", words=True),
        Column("position, RMS error", small),
        Column("largest error", small),
        Column("moved", unit),
        Column("velocity, RMS error", f"{unit}/s" if " or " not in unit else "per s"),
        Column("torque, RMS difference", effort),
        Column("position, CAD/URDF model", small),
    )
    prior = np.full(len(joints), np.nan) if score.prior_rms is None else score.prior_rms
    numbers = np.column_stack(
        [MILLI * score.rms, MILLI * score.peak, score.travelled, velocity, torque, MILLI * prior]
    )
    rows = [
        (TableCell(label_of(joints, j), kind="name"), *(_cell(float(x)) for x in numbers[j]))
        for j in range(len(joints))
    ]
    note = (
        "Moved: RMS distance of the recorded position from the start of its window, the error of a model that "
        "predicts no motion. Torque: simulated minus recorded torque, which is the feedback of the controller; "
        "without a controller the recorded torque acts. CAD/URDF model: inertial parameters of the description, "
        "without friction. Windows that were lost do not count."
    )
    return Table(f"rollout-{number}", f"Errors on {name}", columns, rows, note)


def _cell(value: float) -> TableCell:
    return TableCell(short(value), value) if np.isfinite(value) else TableCell("–", "")


def _rms(error: Array) -> Array:
    """RMS for each joint, shape (n,), of the errors (W, S, n) in W windows of S samples; NaN without windows."""
    return np.sqrt(np.mean(error**2, axis=(0, 1))) if len(error) else np.full(error.shape[2], np.nan)


def _plots(joint: Joint, number: int, j: int, simulated: SimulatedWindows) -> tuple[Plot, ...]:
    """Plots of position, position error and torque of one joint over time, with gaps between the windows."""
    windows, found = simulated.windows, simulated.found
    time = _gapped(simulated.time)
    recorded, position = _gapped(windows.q[:, :, j]), _gapped(found.q[:, :, j])
    measured, acting = _gapped(windows.torque[:, :, j]), _gapped(found.torque[:, :, j])
    error = MILLI * (position - recorded)

    def plot(key: str, title: str, caption: str, axis: str, *traces: tuple[str, Array, str], level: bool) -> Plot:
        return Plot(
            f"rollout-{key}-{number}-{j}",
            title,
            caption,
            "time [s]",
            axis,
            tuple(line(role, time, values, name) for role, values, name in traces),
            group=f"rollout-{number}",
            axes=Axes(levels=(0.0,) if level else ()),
        )

    both = ("measured", "recorded"), ("predicted", "simulated")
    return (
        plot("q", "Position", f"moves from {_range(recorded)} {joint.unit}", f"q [{joint.unit}]",
             *((role, values, name) for (role, name), values in zip(both, (recorded, position), strict=True)),
             level=False),
        plot("error", "Position error", f"largest {_largest(error)} m{joint.unit}", f"error [m{joint.unit}]",
             ("training", error, "error"), level=True),
        plot("torque", "Torque", f"largest difference {_largest(acting - measured)} {joint.effort_unit}",
             f"torque [{joint.effort_unit}]",
             *((role, values, name) for (role, name), values in zip(both, (measured, acting), strict=True)),
             level=False),
    )  # fmt: skip


def _gapped(values: Array) -> Array:
    """Values of all windows (W, S) one after the other, with NaN after each window."""
    return np.pad(values, ((0, 0), (0, 1)), constant_values=np.nan).ravel()


def _range(values: Array) -> str:
    return f"{short(float(np.nanmin(values)))} to {short(float(np.nanmax(values)))}"


def _largest(error: Array) -> str:
    known = np.abs(error[np.isfinite(error)])
    return short(float(known.max())) if len(known) else "unknown"


ROLLOUT: Mapping[str, Callable[[tuple[Joint, ...], RunRollout], Section]] = {"rollout": rollout_section}
"""Sections of the page, by the names of their templates."""
