"""Residuals of the model: over time, over velocity, and in frequency."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from armid.report.data.joint_names import heading_of, label_of
from armid.report.data.number_format import fixed, short
from armid.report.data.page_data import PageData, velocity_unit
from armid.report.data.recording_data import RecordingData, joined
from armid.report.plots.traces import MOST_POINTS, Axes, Plot, PlotTrace, Sight, binned, crest, line, points
from armid.report.section import Section, cut_words, effort_unit
from armid.report.tables import Column, Table, TableCell
from armid.values import Array

__all__ = ["show_residuals"]

RANGE_SHARE = 0.1
"""Share of the torque's range that the thesis's Figure 4.3 measures residuals by."""

IN_SIGHT = 1.5
"""Lines further out than so many times the largest residual are left out: they would flatten what there is to see."""

BINS = 16
"""Bins of velocity: a tenth or so of the range each, with tens of rows in most."""

FEWEST_IN_BIN = 8
"""Rows below which a mean is noise."""

DEEPEST = 1e-6
"""Share of the largest density below which a spectrum is rounding or the skirt of a filter."""

ROLES = {"train": ("training", "training"), "validate": ("validation", "validation")}


def show_residuals(material: PageData) -> Section | None:
    """Residuals of the recordings at hand."""
    drawn = material.drawn
    if not drawn:
        return None
    rows = tuple(
        (
            heading_of(material.joints, j),
            (_over_time(material, drawn, j), _over_velocity(material, drawn, j), *_spectra(material, j)),
        )
        for j in range(len(material.joints))
    )
    legend = (
        ("training", "training"),
        ("validation", "validation"),
        ("above", "beyond the picture"),
        ("mean", "mean in bins of velocity"),
        ("recorded", "spectrum of the torque"),
        ("level", "± 10 % of the torque's range; cut-off of the study's band"),
    )
    return Section("Residuals", {}, (_table(material, drawn),), rows, legend)


def _table(material: PageData, drawn: Sequence[RecordingData]) -> Table:
    unit = effort_unit(material)
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
    for j in range(len(material.joints)):
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
            [TableCell(label_of(material.joints, j), kind="name"), *cells, TableCell(fixed(within, 1), within)]
        )
    what = "validation motion" if held_out[0].choice.role == "validate" else "training motion"
    note = "10 % of range: of the difference between the largest and smallest measured torque."
    return Table("residuals", f"Residuals on {what}", columns, rows, note, folded=True)


def _pooled(evidence: Sequence[RecordingData], j: int) -> Array:
    residual = joined(evidence, "residual", j)
    return residual[np.isfinite(residual)]


def _level(evidence: Sequence[RecordingData], j: int) -> float:
    """A tenth of the range of the torque."""
    measured = joined(evidence, "measured", j)
    known = measured[np.isfinite(measured)]
    return RANGE_SHARE * float(np.ptp(known)) if len(known) else np.nan


def _over_time(material: PageData, drawn: Sequence[RecordingData], j: int) -> Plot:
    unit = material.joints[j].effort_unit
    traces: list[PlotTrace] = []
    sight = Sight.of(_pooled(drawn, j))
    for each in drawn:
        role, name = ROLES[each.choice.role]
        time, residual = each.gapped(each.residual[:, j])
        traces += [line(role, time, residual, name), *sight.cut(time, residual, name)]
    level = _level(drawn, j)
    top = min(sight.limit, sight.peak)
    return Plot(
        f"residual-time-{j}",
        "Over time",
        "; ".join(filter(None, [f"± 10 % of the torque's range is ± {short(level)} {unit}", cut_words(sight, unit)])),
        drawn[0].clock,
        f"residual [{unit}]",
        traces,
        group="residual-time",
        axes=Axes(levels=(-level, level) if level <= IN_SIGHT * top else (), span=sight.span),
    )


def _over_velocity(material: PageData, drawn: Sequence[RecordingData], j: int) -> Plot:
    joint = material.joints[j]
    traces: list[PlotTrace] = []
    for each in drawn:
        role, name = ROLES[each.choice.role]
        traces.append(points(role, each.dq[:, j], each.residual[:, j], name, MOST_POINTS // len(drawn)))
    sight = Sight.of(_pooled(drawn, j))
    velocity = joined(drawn, "dq", j)
    residual = joined(drawn, "residual", j)
    edges = np.linspace(velocity.min(), velocity.max(), BINS + 1)
    where, mean, _ = binned(velocity, residual, edges, FEWEST_IN_BIN)
    largest = float(np.nanmax(np.abs(mean), initial=0.0))
    traces += [*sight.cut(velocity, residual, "residual"), PlotTrace("mean", where, mean, "mean")]
    return Plot(
        f"residual-velocity-{j}",
        "Over velocity",
        f"bin means up to {short(largest)} {joint.effort_unit}",
        f"velocity [{velocity_unit(joint)}]",
        f"residual [{joint.effort_unit}]",
        traces,
        axes=Axes(span=sight.span),
    )


def _spectra(material: PageData, j: int) -> tuple[Plot, ...]:
    """The spectrum of the first recording that has one, validation before training."""
    found = next((each for each in material.drawn if each.spectrum is not None), None)
    if found is None or found.spectrum is None:
        return ()
    unit = material.joints[j].effort_unit
    spectrum, role = found.spectrum, ROLES[found.choice.role]
    floor = DEEPEST * float(spectrum.measured[:, j].max())
    densities = (np.where(x[:, j] < floor, np.nan, x[:, j]) for x in (spectrum.measured, spectrum.residual))
    lines = zip(("recorded", role[0]), ("torque", "residual"), densities, strict=True)
    processing = material.run.processing
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
