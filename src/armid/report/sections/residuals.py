"""Section of the model's residuals: over time, over velocity and in frequency."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from armid.checked_array import Array
from armid.report.data.joint_names import heading_of, label_of
from armid.report.data.number_format import fixed, short
from armid.report.data.page_data import PageData, velocity_unit
from armid.report.data.recording_data import RecordingData, concatenated
from armid.report.plots.plot_specification import (
    MAX_POINTS,
    Axes,
    Plot,
    PlotRange,
    PlotTrace,
    binned,
    crest,
    line,
    points,
)
from armid.report.section import Section, clipped_caption, effort_unit
from armid.report.tables import Column, Table, TableCell

RANGE_SHARE = 0.1
"""Share of the range of the measured torque with which residuals are compared, as in Figure 4.3 of the thesis."""

MAX_LEVEL_RATIO = 1.5
"""Ratio of a level line to the largest residual above which the line is not drawn, because the residuals would look
flat."""

BINS = 16
"""Number of velocity bins; most have tens of rows."""

MIN_BIN_ROWS = 8
"""Smallest number of rows in a velocity bin; the mean of fewer rows is mostly noise."""

MIN_DENSITY_SHARE = 1e-6
"""Share of the largest density below which a spectrum shows only rounding or the filter's stop-band."""

ROLES = {"train": ("training", "training"), "validate": ("validation", "validation")}


def show_residuals(page_data: PageData) -> Section | None:
    """Section of the residuals of the available recordings; `None` if no recording is available."""
    drawn = page_data.drawn
    if not drawn:
        return None
    rows = tuple(
        (
            heading_of(page_data.joints, j),
            (_over_time(page_data, drawn, j), _over_velocity(page_data, drawn, j), *_spectra(page_data, j)),
        )
        for j in range(len(page_data.joints))
    )
    legend = (
        ("training", "training"),
        ("validation", "validation"),
        ("above", "outside the plot"),
        ("mean", "mean in bins of velocity"),
        ("recorded", "spectrum of the torque"),
        ("level", "± 10 % of the torque's range; cut-off of the study's band"),
    )
    return Section("Residuals", {}, (_table(page_data, drawn),), rows, legend)


def _table(page_data: PageData, drawn: Sequence[RecordingData]) -> Table:
    unit = effort_unit(page_data)
    columns = (
        Column("joint", words=True),
        Column("RMS", unit),
        Column("mean", unit),
        Column("largest", unit),
        Column("10 % of range", unit),
        Column("rows within", "%"),
    )
    held_out = [each for each in drawn if each.choice.role == "validate"] or list(drawn)
    rows: list[list[TableCell]] = []
    for j in range(len(page_data.joints)):
        residual, level = _pooled(held_out, j), _level(held_out, j)
        numbers = (
            float(np.sqrt(np.mean(residual**2))),
            float(np.mean(residual)),
            float(np.max(np.abs(residual))),
            level,
        ) if len(residual) else (np.nan,) * 4  # fmt: skip
        within = 100.0 * float(np.mean(np.abs(residual) <= level)) if len(residual) else np.nan
        cells = [TableCell(short(x), x) for x in numbers]
        rows.append(
            [TableCell(label_of(page_data.joints, j), kind="name"), *cells, TableCell(fixed(within, 1), within)]
        )
    what = "validation motion" if held_out[0].choice.role == "validate" else "training motion"
    note = "10 % of range: a tenth of the difference between the largest and smallest measured torque."
    return Table("residuals", f"Residuals on {what}", columns, rows, note, folded=True)


def _pooled(recordings: Sequence[RecordingData], j: int) -> Array:
    residual = concatenated(recordings, "residual", j)
    return residual[np.isfinite(residual)]


def _level(recordings: Sequence[RecordingData], j: int) -> float:
    """Tenth of the range of the measured torque of joint `j` [N·m or N]."""
    measured = concatenated(recordings, "measured", j)
    known = measured[np.isfinite(measured)]
    return RANGE_SHARE * float(np.ptp(known)) if len(known) else np.nan


def _over_time(page_data: PageData, drawn: Sequence[RecordingData], j: int) -> Plot:
    unit = page_data.joints[j].effort_unit
    traces: list[PlotTrace] = []
    plot_range = PlotRange.of(_pooled(drawn, j))
    for each in drawn:
        role, name = ROLES[each.choice.role]
        time, residual = each.gapped(each.residual[:, j])
        traces += [line(role, time, residual, name), *plot_range.cut(time, residual, name)]
    level = _level(drawn, j)
    top = min(plot_range.limit, plot_range.peak)
    return Plot(
        f"residual-time-{j}",
        "Over time",
        "; ".join(
            filter(
                None, [f"± 10 % of the torque's range is ± {short(level)} {unit}", clipped_caption(plot_range, unit)]
            )
        ),
        drawn[0].clock,
        f"residual [{unit}]",
        traces,
        group="residual-time",
        axes=Axes(levels=(-level, level) if level <= MAX_LEVEL_RATIO * top else (), span=plot_range.span),
    )


def _over_velocity(page_data: PageData, drawn: Sequence[RecordingData], j: int) -> Plot:
    joint = page_data.joints[j]
    traces: list[PlotTrace] = []
    for each in drawn:
        role, name = ROLES[each.choice.role]
        traces.append(points(role, each.dq[:, j], each.residual[:, j], name, MAX_POINTS // len(drawn)))
    plot_range = PlotRange.of(_pooled(drawn, j))
    velocity = concatenated(drawn, "dq", j)
    residual = concatenated(drawn, "residual", j)
    edges = np.linspace(velocity.min(), velocity.max(), BINS + 1)
    where, mean, _ = binned(velocity, residual, edges, MIN_BIN_ROWS)
    largest = float(np.nanmax(np.abs(mean), initial=0.0))
    traces += [*plot_range.cut(velocity, residual, "residual"), PlotTrace("mean", where, mean, "mean")]
    return Plot(
        f"residual-velocity-{j}",
        "Over velocity",
        f"bin means up to {short(largest)} {joint.effort_unit}",
        f"velocity [{velocity_unit(joint)}]",
        f"residual [{joint.effort_unit}]",
        traces,
        axes=Axes(span=plot_range.span),
    )


def _spectra(page_data: PageData, j: int) -> tuple[Plot, ...]:
    """Plot of the spectra of joint `j`, from the first recording with a spectrum, validation before training."""
    shown = next((each for each in page_data.drawn if each.spectrum is not None), None)
    if shown is None or shown.spectrum is None:
        return ()
    unit = page_data.joints[j].effort_unit
    spectrum, role = shown.spectrum, ROLES[shown.choice.role]
    floor = MIN_DENSITY_SHARE * float(spectrum.measured[:, j].max())
    densities = (np.where(x[:, j] < floor, np.nan, x[:, j]) for x in (spectrum.measured, spectrum.residual))
    lines = zip(("recorded", role[0]), ("torque", "residual"), densities, strict=True)
    processing = page_data.run.processing
    cutoff = float(processing.cutoff) if processing.family != "none" else 0.0
    marks = (cutoff,) if cutoff > 0.0 else ()
    words = f"cut-off at {cutoff:g} Hz" if marks else "no filter"
    return (
        Plot(
            f"residual-spectrum-{j}",
            "In frequency",
            f"{role[1]}, as recorded; {words}",
            "frequency [Hz]",
            f"density [{unit}/√Hz]",
            [crest(kind, spectrum.frequency, density, name) for kind, name, density in lines],
            group="residual-spectrum",
            axes=Axes(logarithmic=True, marks=marks),
        ),
    )
