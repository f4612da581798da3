"""Section of the groupings of standard parameters: columns without effect, and dependent columns."""

from __future__ import annotations

from armid.model.base_formulas import column_names, column_sums
from armid.report.data.page_data import PageData
from armid.report.section import Section
from armid.report.tables import Column, Table, TableCell


def show_groupings(page_data: PageData) -> Section | None:
    """Section of the columns removed from the regressor, and of their dependence on the remaining columns."""
    base = page_data.run.estimate.base
    if not len(base.removed):
        return None
    names = base.standard_names
    idle = {names[k] for k in base.zero_columns}
    latex = column_names(base, "latex")
    sums = column_sums(base, names), column_sums(base, column_names(base)), column_sums(base, latex, "latex")
    rows: list[list[TableCell]] = []
    for k, shown, text, tex in zip(base.removed, *sums, strict=True):
        if names[k] not in idle:
            head = TableCell(names[k], latex=f"${latex[k]}$", kind="name")
            rows.append([head, TableCell(shown.replace("-", "−"), text, f"${tex}$", "formula")])
    columns = (Column("parameter", words=True), Column("acts on the torque as", words=True))
    table = Table(
        "groupings", "Standard parameters that are grouped into other parameters", columns, rows, folded=True
    )
    content = {"standard": len(names), "base": base.count, "idle": sorted(idle, key=names.index)}
    return Section("Base groupings", content, (table,) if rows else ())
