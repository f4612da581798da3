"""Friction law of each joint as one line of text, and tables of the friction selection."""

from __future__ import annotations

import re
from collections.abc import Sequence
from itertools import groupby

from armid.estimation.friction.selection import SelectionEvidence
from armid.model.terms.term import Law
from armid.model.torque_law_expression import text
from armid.report.data.joint_names import label_of
from armid.report.data.number_format import fixed
from armid.report.data.page_data import PageData
from armid.report.data.recording_data import friction_columns
from armid.report.tables import Column, Table, TableCell
from armid.robot import Joint


def law_tables(page_data: PageData) -> tuple[Table, ...]:
    """Table of the friction law of each joint.

    If armid selected the laws, the table also shows the relative error with the selected friction, and a second
    table, which is folded, lists all candidate friction laws.
    """
    joints, selection = page_data.joints, page_data.records.friction
    laws = [law_text([law for law in _laws(page_data) if law.joint == j]) for j in range(len(joints))]
    note = "q: position, dq: velocity of the joint; the parameters are in the table of parameters."
    head = [Column("joint", words=True), Column("law", words=True)]
    rows = [
        [TableCell(label_of(joints, j), kind="name"), TableCell(law or "–", law, kind="formula")]
        for j, law in enumerate(laws)
    ]
    if selection is None:
        return (Table("laws", "Law of friction, joint by joint", head, rows, note),)
    for row, joint, ratio, deviation in zip(rows, joints, selection.ratio, selection.deviation, strict=True):
        text_of_ratio = f"{fixed(ratio, 2)} ± {fixed(deviation, 2)}"
        row[1:1] = [TableCell("; ".join(selection.chosen(joint.name)) or "–"), TableCell(text_of_ratio, float(ratio))]
    head[1:1] = [Column("selected in addition to viscous and Coulomb friction", words=True), Column("relative error")]
    candidates = _candidate_table(selection.evidence, joints)
    if candidates.rows:
        note += (
            " Relative error: error on held-out blocks with the selected friction, divided by the error "
            "without it, ± its standard error. The selection used the same blocks, so the relative error is "
            "optimistic; the validation error is not."
        )
    note += f" {selection.why}" if selection.why else ""
    laws_of_all = Table("laws", "Law of friction, joint by joint, and its selection", head, rows, note)
    return (laws_of_all, candidates) if candidates.rows else (laws_of_all,)


def law_text(laws: Sequence[Law]) -> str:
    """Text of the friction laws of one joint as a sum; hysteresis elements of several widths have a common term.

    For instance `FV · dq + FS · tanh(50 dq) + Σ FHₖ · slip(q, rₖ), k = 1…3, r = 0.001, 0.003, 0.01`.
    """
    parts: list[str] = []
    definitions: list[str] = []
    for hysteretic, group in groupby(laws, lambda law: law.memory is not None):
        same_kind = list(group)
        if not hysteretic:
            parts += [_without_hysteresis(law) for law in same_kind]
            continue
        widths = [f"{law.memory.width:g}" for law in same_kind if law.memory is not None]
        symbol = same_kind[0].symbol.rstrip("0123456789")
        count = "1" if len(same_kind) == 1 else f"1…{len(same_kind)}"
        parts.append(f"Σ {symbol}ₖ · slip(q, rₖ)" if len(same_kind) > 1 else f"{same_kind[0].symbol} · slip(q, r)")
        definitions.append(f"k = {count}, r = {', '.join(widths)}" if len(same_kind) > 1 else f"r = {widths[0]}")
    formula = ", ".join([" + ".join(parts), *definitions]) if parts else ""
    formula = re.sub(r"\+ -(?:1 )?", "− ", formula)
    return re.sub(r"-(?:1 )?(?=[\w(|])", "−", formula)


def _without_hysteresis(law: Law) -> str:
    """Formula of a law without hysteresis; if it acts on several joints, their weighted sum follows after `of`."""
    formula = f"{law.symbol} · {text(law.expression)}".removesuffix(" · 1")
    if len(law.coordinate) == 1:
        return formula
    weighted = " + ".join(f"{weight:g} q{j + 1}" for j, weight in law.coordinate)
    return f"{formula} of {weighted}"


def _laws(page_data: PageData) -> list[Law]:
    """Friction laws of the model of a run, joint by joint."""
    model = page_data.run.model
    chosen = friction_columns(model)[model.law_columns].astype(bool)
    return [law for (_, law), is_friction in zip(model.laws, chosen, strict=True) if is_friction]


def _candidate_table(evidence: Sequence[SelectionEvidence], joints: Sequence[Joint]) -> Table:
    """Table of all candidate friction laws, joint by joint, with the relative error of each."""
    names = [joint.name for joint in joints]
    rows = [
        [
            TableCell(each.candidate),
            TableCell(fixed(each.ratio, 3), each.ratio),
            TableCell(fixed(each.deviation, 3), each.deviation),
            TableCell("chosen" if each.chosen else ""),
        ]
        for each in evidence
    ]
    groups = {
        k: f"joint {label_of(joints, names.index(each.joint))}"
        for k, each in enumerate(evidence)
        if k == 0 or evidence[k - 1].joint != each.joint
    }
    columns = (
        Column("candidate", words=True),
        Column("relative error"),
        Column("standard error"),
        Column("", words=True),
    )
    title = f"All {len(evidence)} candidate friction laws"
    note = "Relative error: error on held-out blocks with the candidate, divided by the error without it."
    return Table("ladder", title, columns, rows, note, folded=True, groups=groups)
