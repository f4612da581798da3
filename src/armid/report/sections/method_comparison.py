"""Section of the comparison of all estimation methods on the data of a run, made by `identify --compare`."""

from __future__ import annotations

import numpy as np

from armid.report.data.number_format import short
from armid.report.data.page_data import PageData
from armid.report.section import Section, effort_unit
from armid.report.tables import Column, Table, TableCell
from armid.study.compare_methods import MethodScore


def show_methods(page_data: PageData) -> Section | None:
    """Section of the comparison of estimation methods; `None` if the run has no comparison."""
    table_of_methods = page_data.records.methods
    if table_of_methods is None:
        return None
    unit = effort_unit(page_data)
    columns = (
        Column("method", words=True),
        Column("training RMS", unit),
        Column("held-out RMS", unit),
        Column("physically consistent", words=True),
        Column("distance"),
        Column("set to zero"),
        Column("time", "s"),
        Column("", words=True),
    )
    rows = [_row(each, page_data.run.estimate.method) for each in table_of_methods.scores]
    note = (
        "RMS over all joints, root of the sum of squares. Distance: to the nearest consistent parameters, Euclidean, "
        "SI units."
    )
    table = Table("methods", "All methods on the same data", columns, rows, note)
    return Section("Methods compared", {"unseen": table_of_methods.unseen}, (table,))


def _row(score: MethodScore, method_of_run: str) -> list[TableCell]:
    consistent = {True: "yes", False: "no", None: "–"}[score.consistent]
    remark = score.failure or ("this run" if score.method == method_of_run else "")
    numbers = [float(np.linalg.norm(each)) for each in (score.training, score.unseen)]
    distance = np.nan if score.consistent else score.distance  # of consistent values it is the solver's tolerance
    return [
        TableCell(score.method, kind="name"),
        *(TableCell(short(x), x) for x in numbers),
        TableCell(consistent),
        TableCell(short(distance), distance),
        TableCell(str(score.dropped), score.dropped),
        TableCell(short(score.seconds, 2), score.seconds),
        TableCell(remark),
    ]
