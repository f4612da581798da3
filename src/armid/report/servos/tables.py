"""Tables of a servo result: closed-loop position errors, and parameters with intervals and origin."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from armid.checked_array import Array
from armid.report.data.joint_names import heading_of, label_of
from armid.report.data.number_format import share, short
from armid.report.section import Section
from armid.report.servos.page_data import ServoPageData
from armid.report.tables import Column, Table, TableCell
from armid.servo.estimate_table import EstimatedValue
from armid.servo.quantities import POSITION_ERROR, quantity_of

ORIGINS = {
    "identified": "",
    "weakly identified": "",
    "prior-dominated": "guessed",
    "not identifiable": "poor",
    "given": "",
}
"""Style of the cell with the origin of a value."""

ERRORS_NOTE = (
    "RMS of the measured minus the simulated position; the arm is simulated from the first position of each "
    "recording to its end under the recorded commands. Command = position: the error of an arm that is where its "
    "commands are. Description: the description as it stands, with its own servos, friction and rotor inertia. Band: "
    "half the width of the 95 % band, from parts that were left out of training; inside: the share of the rows of "
    "validation in it."
)

VALUES_NOTE = (
    "Intervals are 95 % intervals. They are lower limits: backlash, flexible links and friction that depends on load "
    "are not part of the model. Information: share of the information that comes from the recordings, the rest from "
    "the prior. Weakly identified: the recordings determine it, but the interval is wide."
)


def errors_section(page_data: ServoPageData) -> Section:
    """Section of the closed-loop position errors: by joint, and by recording."""
    tables = [_by_joint(page_data)]
    if page_data.stored.errors.score is not None and len(page_data.stored.errors.score.model.runs) > 1:
        tables.append(_by_run(page_data))
    return Section("Position error of the closed loop", tables=tuple(tables))


def parameters_section(page_data: ServoPageData) -> Section:
    """Section of gains, friction, rotor inertias, offsets and delays, with intervals and origin."""
    joints, rows = page_data.joints, list[list[TableCell]]()
    groups: dict[int, str] = {}
    for j, joint in enumerate(joints):
        groups[len(rows)] = heading_of(joints, j)
        for kind, each in page_data.stored.joint_values(j).items():
            quantity = quantity_of(kind)
            unit = quantity.unit(joint) or next(
                (law.unit for law in page_data.stored.model.laws if (law.symbol, law.joint) == (kind, j)), ""
            )
            numbers = [quantity.scale * x for x in (each.value, each.low, each.high)]
            ends = [TableCell("", "")] * 2 if each.origin == "given" else [_cell(x) for x in numbers[1:]]
            rows.append(
                [
                    TableCell(quantity.title),
                    _cell(numbers[0]),
                    *ends,
                    TableCell(unit),
                    TableCell(share(each.information), each.information),
                    TableCell(each.origin, kind=ORIGINS[each.origin]),
                ]
            )
    columns = (
        Column("parameter", words=True),
        Column("value"),
        Column("from"),
        Column("to"),
        Column("unit", words=True),
        Column("information"),
        Column("origin", words=True),
    )
    table = Table("servo-values", "Servos and friction", columns, rows, VALUES_NOTE, groups=groups)
    reasons = [
        (f"{quantity_of(each.kind).title} of {label_of(joints, each.joint)}", each.reason)
        for each in page_data.stored.values
        if each.reason
    ]
    return Section("Parameters", {"counts": counts(page_data.stored.values), "reasons": reasons}, (table,))


def counts(values: Sequence[EstimatedValue]) -> list[tuple[str, int]]:
    """Number of values of each origin that occurs."""
    found = [(origin, sum(each.origin == origin for each in values)) for origin in ORIGINS]
    return [(origin, number) for origin, number in found if number]


def _by_joint(page_data: ServoPageData) -> Table:
    errors, joints = page_data.stored.errors, page_data.joints
    unit = POSITION_ERROR.units(joints)
    columns = [Column("joint", words=True)]
    numbers: list[tuple[Array, float]] = []

    def add(title: str, of_joints: Array, total: float = np.nan) -> None:
        columns.append(Column(title, unit))
        numbers.append((POSITION_ERROR.scale * of_joints, POSITION_ERROR.scale * total))

    score = errors.score
    if score is not None:
        add("command = position", score.command.joints, score.command.total)
        if score.described is not None:
            add("description", score.described.joints, score.described.total)
        add("identified", score.model.joints, score.model.total)
    add("95 % band, ±", errors.band)
    add("left-out parts", errors.left_out.joints, errors.left_out.total)
    add("training", errors.training.joints, errors.training.total)
    rows = [
        [TableCell(label_of(joints, j), kind="name"), *(_cell(float(of[j])) for of, _ in numbers)]
        for j in range(len(joints))
    ]
    rows.append([TableCell("all joints", kind="name"), *(_cell(total) for _, total in numbers)])
    if score is not None:
        columns.append(Column("inside"))
        inside = [*score.coverage, float(np.mean(score.coverage))]
        for row, each in zip(rows, inside, strict=True):
            row.append(TableCell(share(float(each)), float(each)))
    return Table("servo-errors", "Closed-loop position error, joint by joint", columns, rows, ERRORS_NOTE)


def _by_run(page_data: ServoPageData) -> Table:
    score = page_data.stored.errors.score
    assert score is not None, "there are validation runs"
    names = page_data.names or [f"part {k + 1}" for k in range(len(score.model.runs))]
    each = [("command = position", score.command)]
    each += [] if score.described is None else [("description", score.described)]
    each += [("identified", score.model)]
    unit = POSITION_ERROR.units(page_data.joints)
    columns = [Column("recording", words=True), *(Column(title, unit) for title, _ in each)]
    rows = [
        [TableCell(name), *(_cell(POSITION_ERROR.scale * float(error.runs[k])) for _, error in each)]
        for k, name in enumerate(names)
    ]
    return Table("servo-recordings", "Closed-loop position error, recording by recording", columns, rows)


def _cell(value: float) -> TableCell:
    return TableCell(short(value), value) if np.isfinite(value) else TableCell("–", "")
