"""Section of the excitation: ranges of the motion, and condition of the regressor."""

from __future__ import annotations

import math

import numpy as np

from armid.report.data.joint_names import label_of
from armid.report.data.number_format import fixed, short
from armid.report.data.page_data import PageData
from armid.report.section import Section, effort_unit, one_of
from armid.report.tables import Column, Table, TableCell


def show_excitation(page_data: PageData) -> Section:
    """Section of condition numbers and of each joint's motion in training."""
    fit = page_data.run.estimate.fit
    content = {
        "condition": short(fit.condition),
        "scaled": short(fit.scaled_condition),
        "rows": int(fit.rows.max()),
        "blocks": str(fit.report.parts or ""),
        "folder": page_data.run.folder,
    }
    return Section("Excitation", content, (_table(page_data),) if page_data.of_role("train") else ())


def _table(page_data: PageData) -> Table:
    joints, train = page_data.joints, page_data.of_role("train")
    unit, effort = one_of([joint.unit for joint in joints]), effort_unit(page_data)
    columns = (
        Column("joint", words=True),
        Column("position from", unit),
        Column("to", unit),
        Column("of its range", "%"),
        Column("fastest", f"{unit}/s" if " " not in unit else ""),
        Column("of its limit", "%"),
        Column("torque from", effort),
        Column("to", effort),
        Column("of its limit", "%"),
    )
    rows: list[list[TableCell]] = []
    for j, joint in enumerate(joints):
        q, dq, tau = (np.concatenate([of[:, j] for of in x]) for x in zip(
            *((each.q, each.dq, each.measured) for each in train), strict=True))  # fmt: skip
        tau = tau[np.isfinite(tau)] if np.isfinite(tau).any() else np.full(1, np.nan)
        ends = float(q.min()), float(q.max())
        fastest, peak = float(np.abs(dq).max()), float(np.abs(tau).max())
        rows.append(
            [
                TableCell(label_of(joints, j), kind="name"),
                *(TableCell(fixed(x, 2), x) for x in ends),
                _share((ends[1] - ends[0]) / float(np.ptp(joint.position_limits))),
                TableCell(short(fastest), fastest),
                _share(fastest / joint.velocity_limit),
                *(TableCell(short(float(x)), float(x)) for x in (tau.min(), tau.max())),
                _share(peak / joint.effort_limit),
            ]
        )
    note = "Limits are from the description; a dash if it gives none."
    return Table("excitation", "Motion and torque of each joint in training", columns, rows, note, folded=True)


def _share(value: float) -> TableCell:
    """Cell of the used share of a limit; a dash if the limit is not known."""
    if not math.isfinite(value) or value == 0.0:
        return TableCell("–", "")
    return TableCell(fixed(100.0 * value, 0), 100.0 * value)
