"""Torque measured against predicted, joint by joint, with the band that should hold 95 % of it."""

from __future__ import annotations

import numpy as np

from armid.notebook import names_apart
from armid.report.data.joint_names import heading_of, label_of, residual_title
from armid.report.data.number_format import fixed, share, short
from armid.report.data.page_data import PageData
from armid.report.data.recording_data import RecordingData
from armid.report.data.trust import POOR_COVERAGE
from armid.report.plots.traces import Axes, Plot, Sight, line, spread
from armid.report.section import Section, cut_words, effort_unit
from armid.report.tables import Column, Table, TableCell

__all__ = ["show_torque"]


def show_torque(material: PageData) -> Section:
    """Errors of every joint, and pictures of the recordings at hand, the residual below each torque."""
    drawn = material.drawn
    names = names_apart(each["path"] for each in material.study["recordings"])
    rows = tuple(
        (
            _heading(each, names[each.choice.path]),
            tuple(plot for j in range(len(material.joints)) for plot in _plots(material, number, each, j)),
        )
        for number, each in enumerate(drawn)
    )
    legend = (
        ("measured", "measured, in the study's band"),
        ("predicted", "predicted"),
        ("band", "95 % band of prediction and residual"),
        ("training", "residual: measured less predicted"),
        ("above", "residual beyond the picture"),
    )
    content = {
        "missing": material.missing,
        "left_out": len(material.evidence) - len(drawn),
        "folder": material.run.folder,
    }
    return Section("Torque, measured and predicted", content, (_table(material),), rows, legend if rows else ())


def _heading(evidence: RecordingData, name: str) -> str:
    """Return what stands above a recording's plots: its role, its name, its part."""
    choice = evidence.choice
    part = "" if choice.part == (0.0, 1.0) else f", {share(choice.part[0])} to {share(choice.part[1])} of it"
    role = "Validation" if choice.role == "validate" else "Training"
    return f"{role}: {name}{part}"


def _table(material: PageData) -> Table:
    unit = effort_unit(material)
    columns = (
        Column("joint", words=True),
        Column("training RMS", unit),
        Column("validation RMS", unit),
        Column("validation, as recorded", unit),
        Column("CAD/URDF model", unit),
        Column("relative RMS", "%"),
        Column("largest error", unit),
        Column("inside 95 % band", "%"),
    )
    training = material.run.estimate.fit.residual_rms
    held_out = material.validation_rms()
    keys = ("rms_raw", "prior_rms", "relative", "peak", "coverage95")
    raw, prior, relative, peak, coverage = (material.validation_column(key) for key in keys)
    rows = [
        (
            TableCell(label_of(material.joints, j), kind="name"),
            *(TableCell(short(x), float(x)) for x in (training[j], held_out[j], raw[j], prior[j])),
            TableCell(fixed(100.0 * relative[j], 1), float(100.0 * relative[j])),
            TableCell(short(peak[j]), float(peak[j])),
            _coverage(float(coverage[j])),
        )
        for j in range(len(material.joints))
    ]
    note = (
        "RMS in the study's band unless said otherwise. CAD/URDF model: the description's inertial parameters "
        "without friction. Relative RMS: over the torque's standard deviation. ▼ marks bands that hold far fewer "
        "rows than 95 %."
    )
    return Table("torque", "Torque error of each joint", columns, rows, note)


def _coverage(value: float) -> TableCell:
    poor = value < POOR_COVERAGE
    return TableCell(fixed(100.0 * value, 0) + (" ▼" if poor else ""), 100.0 * value, kind="poor" if poor else "")


def _plots(material: PageData, number: int, evidence: RecordingData, j: int) -> tuple[Plot, Plot]:
    """Torque, and below it the residual over the same time."""
    joint, title = material.joints[j], heading_of(material.joints, j)
    unit = joint.effort_unit
    time, values = evidence.gapped(
        np.column_stack(
            [evidence.measured[:, j], evidence.predicted[:, j], evidence.half_band[:, j], evidence.residual[:, j]]
        )
    )
    measured, predicted, half, residual = values.T
    known = np.isfinite(residual)
    inside = float(np.mean(np.abs(residual[known]) <= half[known])) if known.any() else np.nan
    rms = float(np.sqrt(np.mean(residual[known] ** 2))) if known.any() else np.nan
    upper = Plot(
        f"torque-{number}-{j}",
        title,
        f"RMS {short(rms)} {unit}; {share(inside)} inside the band",
        evidence.clock,
        f"torque [{unit}]",
        (
            *spread(time, predicted - half, predicted + half, "95 % band"),
            line("measured", time, measured, "measured"),
            line("predicted", time, predicted, "predicted"),
        ),
        group=f"time-{number}",
    )
    sight = Sight.of(residual)
    lower = Plot(
        f"left-{number}-{j}",
        residual_title(title),
        cut_words(sight, unit) or f"up to {short(sight.peak)} {unit}",
        evidence.clock,
        f"residual [{unit}]",
        (
            *spread(time, -half, half, "95 % band"),
            line("training", time, residual, "residual"),
            *sight.cut(time, residual, "residual"),
        ),
        group=f"time-{number}",
        axes=Axes(levels=(0.0,), span=sight.span),
    )
    return upper, lower
