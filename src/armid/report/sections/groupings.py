"""Section of the groupings of standard parameters: columns without effect, and dependent columns."""

from __future__ import annotations

from armid.model.base_formulas import column_formulas
from armid.report.data.page_data import PageData
from armid.report.section import Section
from armid.report.tables import Column, Table, TableCell

__all__ = ["show_groupings"]


def show_groupings(page_data: PageData) -> Section | None:
    """Section of the removed columns of the regressor and their dependence on the kept ones."""
    base = page_data.run.estimate.base
    if not len(base.removed):
        return None
    names = base.standard_names
    idle = {names[k] for k in base.zero_columns}
    text, latex = column_formulas(base), column_formulas(base, "latex")
    rows: list[list[TableCell]] = []
    for k, plain, tex in zip(base.removed, text, latex, strict=True):
        right, (left_tex, _, right_tex) = plain.partition(" = ")[2], tex.partition(" = ")
        dependence = right.replace("Y_{", "").replace("}", "").replace("-", "−")
        if names[k] not in idle:
            head = TableCell(names[k], latex=f"${left_tex}$", kind="name")
            rows.append([head, TableCell(dependence, right, f"${right_tex}$", "formula")])
    columns = (Column("parameter", words=True), Column("acts on the torque as", words=True))
    table = Table("groupings", "Standard parameters that are contained in others", columns, rows, folded=True)
    content = {"standard": len(names), "base": base.count, "idle": sorted(idle, key=names.index)}
    return Section("Base groupings", content, (table,) if rows else ())
