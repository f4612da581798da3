"""Torque measured against predicted, joint by joint, with the band that should hold 95 % of it."""

from __future__ import annotations

import numpy as np

from armid.report.evidence import Evidence
from armid.report.judgement import POOR_COVERAGE
from armid.report.material import Material
from armid.report.numbers import fixed, share, short
from armid.report.plots import Plot, line, spread
from armid.report.section import Section, effort_unit
from armid.report.tables import Cell, Column, Table
from armid.shown import names_apart

__all__ = ["show_torque"]


def show_torque(material: Material) -> Section:
    """Errors of every joint, and pictures of the recordings that are at hand."""
    drawn = material.drawn
    names = names_apart(each["path"] for each in material.study["recordings"])
    rows = tuple(
        (
            _heading(each, names[each.choice.path]),
            tuple(_plot(material, number, each, j) for j in range(len(material.joints))),
        )
        for number, each in enumerate(drawn)
    )
    legend = (
        ("measured", "measured, in the study's band"),
        ("predicted", "predicted"),
        ("band", "95 % band of prediction and residual"),
    )
    content = {"missing": material.missing, "left_out": len(material.evidence) - len(drawn)}
    return Section("Torque, measured and predicted", content, (_table(material),), rows, legend if rows else ())


def _heading(evidence: Evidence, name: str) -> str:
    """What stands above a recording's plots: its role, its name, its part."""
    choice = evidence.choice
    part = "" if choice.part == (0.0, 1.0) else f", {share(choice.part[0])} to {share(choice.part[1])} of it"
    role = "Unseen motion" if choice.role == "validate" else "Training"
    return f"{role}: {name}{part}"


def _table(material: Material) -> Table:
    unit = effort_unit(material)
    columns = (
        Column("joint", words=True),
        Column("training RMS", unit),
        Column("unseen RMS", unit),
        Column("unseen, as recorded", unit),
        Column("description alone", unit),
        Column("share of torque", "%"),
        Column("largest error", unit),
        Column("inside 95 % band", "%"),
    )
    training = material.run.estimate.fit.residual_rms
    unseen = material.validation_rms()
    keys = ("rms_raw", "prior_rms", "relative", "peak", "coverage95")
    raw, prior, relative, peak, coverage = (material.validation_column(key) for key in keys)
    rows = [
        (
            Cell(joint.name, kind="name"),
            *(Cell(short(x), float(x)) for x in (training[j], unseen[j], raw[j], prior[j])),
            Cell(fixed(100.0 * relative[j], 1), float(100.0 * relative[j])),
            Cell(short(peak[j]), float(peak[j])),
            _coverage(float(coverage[j])),
        )
        for j, joint in enumerate(material.joints)
    ]
    note = (
        "RMS in the study's band unless said otherwise. Description alone: its inertial parameters without friction. "
        "Share of torque: RMS over the torque's standard deviation. ▼ marks bands that hold far fewer rows than 95 %."
    )
    return Table("torque", "Torque error of each joint", columns, rows, note)


def _coverage(value: float) -> Cell:
    poor = value < POOR_COVERAGE
    return Cell(fixed(100.0 * value, 0) + (" ▼" if poor else ""), 100.0 * value, kind="poor" if poor else "")


def _plot(material: Material, number: int, evidence: Evidence, j: int) -> Plot:
    joint = material.joints[j]
    time, values = evidence.gapped(
        np.column_stack(
            [evidence.measured[:, j], evidence.predicted[:, j], evidence.half_band[:, j], evidence.residual[:, j]]
        )
    )
    measured, predicted, half, residual = values.T
    known = residual[np.isfinite(residual)]
    inside = np.mean(np.abs(residual) <= half, where=np.isfinite(residual)) if len(known) else np.nan
    rms = float(np.sqrt(np.mean(known**2))) if len(known) else np.nan
    return Plot(
        f"torque-{number}-{j}",
        joint.name,
        f"RMS {short(rms)} {joint.effort_unit}; {share(float(inside))} inside the band",
        evidence.clock,
        f"torque [{joint.effort_unit}]",
        (
            *spread(time, predicted - half, predicted + half, "95 % band"),
            line("measured", time, measured, "measured"),
            line("predicted", time, predicted, "predicted"),
        ),
        group=f"time-{number}",
    )
