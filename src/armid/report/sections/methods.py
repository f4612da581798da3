"""Section of all methods on the run's data, if `identify --compare` tried them."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from armid.report.data.number_format import short
from armid.report.data.page_data import PageData
from armid.report.section import Section, effort_unit
from armid.report.tables import Column, Table, TableCell

__all__ = ["show_methods"]


def show_methods(page_data: PageData) -> Section | None:
    """Section of the comparison of methods; `None` if there was none."""
    path = Path(page_data.run.folder) / "compare.json"
    if not path.is_file():
        return None
    record = json.loads(path.read_text(encoding="utf-8"))
    unit = effort_unit(page_data)
    columns = (
        Column("method", words=True),
        Column("training RMS", unit),
        Column("held-out RMS", unit),
        Column("physically consistent", words=True),
        Column("distance to one"),
        Column("held at zero"),
        Column("time", "s"),
        Column("", words=True),
    )
    rows = [_row(each, page_data.run.estimate.method) for each in record["methods"]]
    note = (
        "RMS over all joints, root of the sum of squares. Distance: to the nearest consistent parameters, Euclidean, "
        "SI units."
    )
    table = Table("methods", "All methods on the same data", columns, rows, note)
    return Section("Methods compared", {"unseen": record["unseen"]}, (table,))


def _row(record: Mapping[str, Any], method_of_run: str) -> list[TableCell]:
    consistent = {True: "yes", False: "no", None: "–"}[record["consistent"]]
    remark = record["failure"] or ("this run" if record["name"] == method_of_run else "")
    numbers = [np.nan if record[key] is None else float(record[key]) for key in ("training_total", "unseen_total")]
    # For consistent values the distance is only the solver's tolerance.
    distance = np.nan if record["distance"] is None or record["consistent"] else float(record["distance"])
    return [
        TableCell(record["name"], kind="name"),
        *(TableCell(short(x), x) for x in numbers),
        TableCell(consistent),
        TableCell(short(distance), distance),
        TableCell(str(record["dropped"]), record["dropped"]),
        TableCell(short(record["seconds"], 2), record["seconds"]),
        TableCell(remark),
    ]
