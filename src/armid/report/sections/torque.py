"""Section of measured and predicted torque of each joint, with the 95 % prediction interval."""

from __future__ import annotations

import numpy as np

from armid.notebook_display import names_apart
from armid.report.data.joint_names import heading_of, label_of, residual_title
from armid.report.data.number_format import fixed, share, short
from armid.report.data.page_data import PageData
from armid.report.data.recording_data import RecordingData
from armid.report.data.trust import POOR_COVERAGE
from armid.report.plots.plot_specification import Axes, Plot, PlotRange, line, spread
from armid.report.section import Section, clipped_caption, effort_unit
from armid.report.tables import Column, Table, TableCell
from armid.validation.left_out_error import LeftOutError


def show_torque(page_data: PageData) -> Section:
    """Section of torque errors, with plots of the available recordings and their residuals."""
    drawn = page_data.drawn
    names = names_apart(each.path for each in page_data.study.recordings)
    rows = tuple(
        (
            _heading(each, names[each.choice.path]),
            tuple(plot for j in range(len(page_data.joints)) for plot in _plots(page_data, number, each, j)),
        )
        for number, each in enumerate(drawn)
    )
    legend = (
        ("measured", "measured, in the study's band"),
        ("predicted", "predicted"),
        ("band", "95 % prediction interval"),
        ("training", "residual: measured minus predicted"),
        ("above", "residual outside the plot"),
    )
    content = {
        "missing": page_data.missing,
        "left_out": len(page_data.recordings) - len(drawn),
        "folder": page_data.run.folder,
    }
    return Section("Torque, measured and predicted", content, (_table(page_data),), rows, legend if rows else ())


def _heading(recording: RecordingData, name: str) -> str:
    """Heading of the plots of a recording: role and name of the recording, and the part that is used."""
    choice = recording.choice
    part = "" if choice.part == (0.0, 1.0) else f", {share(choice.part[0])} to {share(choice.part[1])} of it"
    role = "Validation" if choice.role == "validate" else "Training"
    return f"{role}: {name}{part}"


def _table(page_data: PageData) -> Table:
    unit = effort_unit(page_data)
    columns = (
        Column("joint", words=True),
        Column("training RMS", unit),
        Column("validation RMS", unit),
        Column("with own offset", unit),
        Column("expected on another", unit),
        Column("validation, as recorded", unit),
        Column("CAD/URDF model", unit),
        Column("relative RMS", "%"),
        Column("largest error", unit),
        Column("inside 95 % interval", "%"),
        Column("rows used", "%"),
    )
    training = page_data.run.estimate.fit.residual_rms
    held_out = page_data.validation_rms()
    column = page_data.validation_column
    raw, prior, peak = column(lambda s: s.rms_raw), column(lambda s: s.prior_rms), column(lambda s: s.peak)
    relative, coverage = column(lambda s: s.relative), column(lambda s: s.coverage95)
    own, left_out = column(lambda s: s.rms_with_own_offset), page_data.validation.left_out
    used = column(lambda s: s.share)
    rows = [
        (
            TableCell(label_of(page_data.joints, j), kind="name"),
            *(TableCell(short(x), float(x)) for x in (training[j], held_out[j], own[j])),
            _expected(left_out, j),
            *(TableCell(short(x), float(x)) for x in (raw[j], prior[j])),
            TableCell(fixed(100.0 * relative[j], 1), float(100.0 * relative[j])),
            TableCell(short(peak[j]), float(peak[j])),
            _coverage(float(coverage[j])),
            TableCell(fixed(100.0 * used[j], 0), float(100.0 * used[j])),
        )
        for j in range(len(page_data.joints))
    ]
    note = (
        "RMS in the band of the study, unless stated otherwise. With own offset: RMS error if the mean error of the "
        "validation recording is subtracted; each recording has its own offset, because sensors are zeroed again. "
        "Expected on another: 90 % interval of the RMS error that the training data let expect on another recording "
        "with such a motion. CAD/URDF model: inertial parameters of the "
        "description, without friction. Relative RMS: RMS error divided by the standard deviation of the measured "
        "torque. Rows used: in the others, the state of hysteresis is unknown. ▼ marks intervals that contain far "
        "fewer rows than 95 %."
    )
    return Table("torque", "Torque error of each joint", columns, rows, note)


def _expected(left_out: LeftOutError | None, j: int) -> TableCell:
    """Cell with the 90 % interval of the RMS error expected on another recording; a dash if it is not known."""
    if left_out is None:
        return TableCell("–")
    low, high = float(left_out.expected.low[j]), float(left_out.expected.high[j])
    return TableCell(f"{short(low, 2)} to {short(high, 2)}", float(left_out.expected.rms[j]))


def _coverage(value: float) -> TableCell:
    poor = value < POOR_COVERAGE
    return TableCell(fixed(100.0 * value, 0) + (" ▼" if poor else ""), 100.0 * value, kind="poor" if poor else "")


def _plots(page_data: PageData, number: int, recording: RecordingData, j: int) -> tuple[Plot, Plot]:
    """Plots of torque and residual of joint `j` in a recording, over the same time axis."""
    joint, title = page_data.joints[j], heading_of(page_data.joints, j)
    unit = joint.effort_unit
    time, values = recording.gapped(
        np.column_stack(
            [recording.measured[:, j], recording.predicted[:, j], recording.half_band[:, j], recording.residual[:, j]]
        )
    )
    measured, predicted, half, residual = values.T
    known = np.isfinite(residual)
    inside = float(np.mean(np.abs(residual[known]) <= half[known])) if known.any() else np.nan
    rms = float(np.sqrt(np.mean(residual[known] ** 2))) if known.any() else np.nan
    upper = Plot(
        f"torque-{number}-{j}",
        title,
        f"RMS {short(rms)} {unit}; {share(inside)} inside the interval",
        recording.clock,
        f"torque [{unit}]",
        (
            spread(time, predicted - half, predicted + half, "95 % band"),
            line("measured", time, measured, "measured"),
            line("predicted", time, predicted, "predicted"),
        ),
        group=f"time-{number}",
    )
    plot_range = PlotRange.of(residual)
    lower = Plot(
        f"left-{number}-{j}",
        residual_title(title),
        clipped_caption(plot_range, unit) or f"up to {short(plot_range.peak)} {unit}",
        recording.clock,
        f"residual [{unit}]",
        (
            spread(time, -half, half, "95 % band"),
            line("training", time, residual, "residual"),
            *plot_range.cut(time, residual, "residual"),
        ),
        group=f"time-{number}",
        axes=Axes(levels=(0.0,), span=plot_range.span),
    )
    return upper, lower
