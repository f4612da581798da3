"""The law of friction of each joint in one line, and how it was chosen."""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from itertools import groupby
from pathlib import Path
from typing import Any

from armid.model.expression import text
from armid.model.terms.term import Law
from armid.report.data.joint_names import label_of
from armid.report.data.number_format import fixed
from armid.report.data.page_data import PageData
from armid.report.data.recording_data import friction_columns
from armid.report.tables import Column, Table, TableCell

__all__ = ["law_tables", "law_text"]


def law_tables(material: PageData) -> tuple[Table, ...]:
    """The laws, one line a joint; where they were chosen, with the choice, and folded all that was looked at."""
    joints, record = material.joints, _ladder(material)
    laws = [law_text([law for law in _laws(material) if law.joint == j]) for j in range(len(joints))]
    note = "q: position, dq: velocity of the joint; the parameters are in the table of parameters."
    head = [Column("joint", words=True), Column("law", words=True)]
    rows = [
        [TableCell(label_of(joints, j), kind="name"), TableCell(law or "–", law, kind="formula")]
        for j, law in enumerate(laws)
    ]
    if record is None:
        return (Table("laws", "Law of friction, joint by joint", head, rows, note),)
    for row, each in zip(rows, record["joints"], strict=True):
        ratio = f"{fixed(each['ratio'], 2)} ± {fixed(each['deviation'], 2)}"
        row[1:1] = [TableCell("; ".join(each["chosen"]) or "–"), TableCell(ratio, each["ratio"])]
    head[1:1] = [Column("chosen beside viscous and Coulomb", words=True), Column("relative error")]
    looked_at = _evidence(record, joints)
    if looked_at.rows:
        note += (
            " Relative error: on stretches of motion that were left out, over that without what was chosen, ± its "
            "standard error. The same stretches made the choice, so it is optimistic; the error in validation is not."
        )
    note += f" {record['why']}" if record["why"] else ""
    laws_of_all = Table("laws", "Law of friction, joint by joint, and how it was chosen", head, rows, note)
    return (laws_of_all, looked_at) if looked_at.rows else (laws_of_all,)


def law_text(laws: Sequence[Law]) -> str:
    """Laws of one joint as a sum; elements with memory of one kind, which differ in their widths alone, as one.

    For instance `FV · dq + FS · tanh(50 dq) + Σ FHₖ · slip(q, rₖ), k = 1…3, r = 0.001, 0.003, 0.01`.
    """
    parts: list[str] = []
    after: list[str] = []
    for remembers, group in groupby(laws, lambda law: law.memory is not None):
        own = list(group)
        if not remembers:
            parts += [_plain(law) for law in own]
            continue
        widths = [f"{law.memory.width:g}" for law in own if law.memory is not None]
        symbol = own[0].symbol.rstrip("0123456789")
        count = "1" if len(own) == 1 else f"1…{len(own)}"
        parts.append(f"Σ {symbol}ₖ · slip(q, rₖ)" if len(own) > 1 else f"{own[0].symbol} · slip(q, r)")
        after.append(f"k = {count}, r = {', '.join(widths)}" if len(own) > 1 else f"r = {widths[0]}")
    said = ", ".join([" + ".join(parts), *after]) if parts else ""
    said = re.sub(r"\+ -(?:1 )?", "− ", said)
    return re.sub(r"-(?:1 )?(?=[\w(|])", "−", said)


def _plain(law: Law) -> str:
    """A law without memory, and the joints that it acts on where these are several."""
    said = f"{law.symbol} · {text(law.expression)}".removesuffix(" · 1")
    if len(law.coordinate) == 1:
        return said
    weighted = " + ".join(f"{weight:g} q{j + 1}" for j, weight in law.coordinate)
    return f"{said} of {weighted}"


def _laws(material: PageData) -> list[Law]:
    """All laws of friction of the model, joint by joint."""
    model = material.run.model
    chosen = friction_columns(model)[model.law_columns].astype(bool)
    return [law for (_, law), own in zip(model.laws, chosen, strict=True) if own]


def _ladder(material: PageData) -> dict[str, Any] | None:
    """Tell how friction was chosen; nothing where it was named and not chosen."""
    path = Path(material.run.folder) / "friction.json"
    return json.loads(path.read_text(encoding="utf-8")) if path.is_file() else None


def _evidence(record: dict[str, Any], joints: Sequence[Any]) -> Table:
    """All candidates that were looked at, by joint."""
    evidence = record["evidence"]
    names = [joint.name for joint in joints]
    rows = [
        [
            TableCell(each["candidate"]),
            TableCell(fixed(each["ratio"], 3), each["ratio"]),
            TableCell(fixed(each["deviation"], 3), each["deviation"]),
            TableCell("chosen" if each["chosen"] else ""),
        ]
        for each in evidence
    ]
    groups = {
        k: f"joint {label_of(joints, names.index(each['joint']))}"
        for k, each in enumerate(evidence)
        if k == 0 or evidence[k - 1]["joint"] != each["joint"]
    }
    columns = (
        Column("candidate", words=True),
        Column("relative error"),
        Column("standard error"),
        Column("", words=True),
    )
    title = f"All {len(evidence)} candidates that were looked at"
    note = "Error over that without the candidate."
    return Table("ladder", title, columns, rows, note, folded=True, groups=groups)
