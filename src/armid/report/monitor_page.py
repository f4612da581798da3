"""Page of a monitor: external torque of a recording, thresholds, and alarms."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np

from armid.checked_array import Array
from armid.notebook_display import plural
from armid.report.data.joint_names import heading_of, label_of
from armid.report.data.number_format import fixed, short, with_half_width
from armid.report.page import assemble
from armid.report.page_file import write_html
from armid.report.plots.plot_specification import Axes, Plot, PlotTrace, line
from armid.report.rendering import require_extra
from armid.report.section import Section, one_of
from armid.report.tables import Column, Table, TableCell
from armid.runs.monitoring.monitor import NO_SAFETY, Alarm, Monitor, Watched

MAX_OPEN = 20
"""Largest number of alarms for which the table of alarms is not folded."""

MILLISECONDS = 1e3

QUANTILE = 1.96
"""Half width of a 95 % interval, as a multiple of the standard deviation."""


def write_monitor_page(monitor: Monitor, watched: Watched, name: str, path: Path | str) -> Path:
    """Writes a page with external torque, thresholds and alarms of a recording.

    Args:
        monitor: The monitor.
        watched: Result of the monitor on the recording.
        name: Name of the recording.
        path: The file; it is written completely or not at all.

    Raises:
        MissingExtraError: jinja2 or plotly is not installed.
        OutputError: The file is not an HTML page, or cannot be written.
    """
    require_extra()
    alarms = plural(len(watched.alarms), "alarm")
    subtitle = f"{name}, {watched.seconds:.1f} s: {alarms}; run {monitor.run.folder}"
    sections = {key: show(monitor, watched) for key, show in MONITOR.items()}
    title = f"{monitor.run.robot.name}: external torque"
    return write_html(path, assemble(title, subtitle, sections, with_plots=True))


def show_alarms(monitor: Monitor, watched: Watched) -> Section:
    """Section of the thresholds and the alarms, with plots of the external torque of each joint."""
    found = monitor.thresholds
    content = {
        "notice": NO_SAFETY,
        "rate": short(found.rate),
        "promised": found.promised,
        "smallest": short(found.smallest) if np.isfinite(found.smallest) else "",
        "minutes": fixed(found.seconds / 60.0, 1),
        "late": fixed(2.0 * MILLISECONDS / monitor.options.gain_at(monitor.rate), 0),
        "observer": monitor.options.kind,
        "findings": [(each.severity, each.code, each.evidence) for each in (*monitor.findings, *watched.findings)],
    }
    joints = monitor.run.robot.joints
    rows = tuple((heading_of(joints, j), (_plot(monitor, watched, j),)) for j in range(len(joints)))
    tables = (_alarms(monitor, watched.alarms), _thresholds(monitor))
    legend = (("measured", "external torque"), ("limit", "threshold"), ("above", "largest excess of an alarm"))
    return Section("Alarms and external torque", content, tables, rows, legend)


def _thresholds(monitor: Monitor) -> Table:
    found, joints = monitor.thresholds, monitor.run.robot.joints
    columns = (
        Column("joint", words=True),
        Column("mean threshold"),
        Column("if it were constant"),
        Column("more at rest"),
        Column("unit", words=True),
        Column("follows the motion", words=True),
    )
    rows = [
        (
            TableCell(label_of(joints, j), kind="name"),
            *(TableCell(short(float(x[j])), float(x[j])) for x in (found.mean, found.constant, found.friction)),
            TableCell(joint.effort_unit),
            TableCell("yes" if found.follows[j] else "no"),
        )
        for j, joint in enumerate(joints)
    ]
    note = "More at rest: dry friction may have any value up to its bound there, so the bound is added."
    return Table("thresholds", "Thresholds", columns, rows, note)


def _alarms(monitor: Monitor, alarms: tuple[Alarm, ...]) -> Table:
    joints = monitor.run.robot.joints
    unit = one_of([joint.effort_unit for joint in joints])
    columns = (
        Column("start", "s"),
        Column("duration", "s"),
        Column("joint", words=True),
        Column("external torque", unit),
        Column("threshold", unit),
        *(Column(f"force {axis} at the tip", "N") for axis in "xyz"),
        *(Column(f"moment {axis} at the tip", "N·m") for axis in "xyz"),
        Column("other joints", words=True),
    )
    rows = [
        (
            TableCell(fixed(alarm.start, 3), alarm.start),
            TableCell(fixed(alarm.duration, 3), alarm.duration),
            TableCell(alarm.joint, kind="name"),
            TableCell(short(alarm.size), alarm.size),
            TableCell(short(alarm.threshold), alarm.threshold),
            *_wrench(alarm),
            TableCell(", ".join(name for name in alarm.joints if name != alarm.joint)),
        )
        for alarm in alarms
    ]
    note = (
        "Values at the largest excess. Force and moment in the axes of the base, as if the contact were at the tip, "
        "± half of the 95 % interval; ?: not determined in the pose of the arm. A contact can exceed the thresholds "
        "of several joints; its alarm is that of the joint with the largest excess."
    )
    return Table("alarms", "Alarms", columns, rows, note, folded=len(rows) > MAX_OPEN)


def _wrench(alarm: Alarm) -> list[TableCell]:
    """Cells of the force and the moment at the tip in x, y and z."""
    if alarm.wrench is None:
        return [TableCell("–", "")] * 6
    return [
        TableCell(with_half_width(float(value), QUANTILE * float(spread)), float(value))
        if np.isfinite(spread)
        else TableCell("?", "")
        for value, spread in zip(alarm.wrench.value, alarm.wrench.deviation, strict=True)
    ]


def _plot(monitor: Monitor, watched: Watched, j: int) -> Plot:
    """Plot of external torque and thresholds of one joint over time, with its alarms."""
    joint = monitor.run.robot.joints[j]
    parts = list(zip(watched.parts, watched.thresholds, strict=True))
    time = _joined([part.time for part, _ in parts])
    external = _joined([np.where(part.usable[:, j], part.external[:, j], np.nan) for part, _ in parts])
    bound = _joined([along[:, j] for _, along in parts])
    own = [alarm for alarm in watched.alarms if alarm.joint == joint.name]
    at, size = (np.array([getattr(alarm, key) for alarm in own], dtype=np.float64) for key in ("time", "size"))
    largest = float(np.nanmax(np.abs(external))) if np.isfinite(external).any() else np.nan
    return Plot(
        f"external-{j}",
        "External torque",
        f"largest {short(largest)} {joint.effort_unit}; {plural(len(own), 'alarm')} of this joint",
        "time [s]",
        f"external torque [{joint.effort_unit}]",
        (
            line("measured", time, external, "external torque"),
            line("limit", time, bound, "threshold"),
            line("limit", time, -bound, "threshold"),
            *([PlotTrace("above", at, size, "alarm", cloud=True)] if own else []),
        ),
        group="external",
        axes=Axes(levels=(0.0,)),
    )


def _joined(parts: list[Array]) -> Array:
    """Values of all parts one after the other, with NaN after each part."""
    return np.concatenate([np.append(part, np.nan) for part in parts])


MONITOR: Mapping[str, Callable[[Monitor, Watched], Section]] = {"external-torque": show_alarms}
"""Sections of the page, by the names of their templates."""
