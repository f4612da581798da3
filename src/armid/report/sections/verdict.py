"""The verdict: what can be trusted, what cannot, and what to record or change next."""

from __future__ import annotations

import numpy as np

from armid.report.data.number_format import share, short
from armid.report.data.page_data import PageData
from armid.report.data.trust import judge_trust
from armid.report.heading import commands_of
from armid.report.section import Section, effort_unit
from armid.report.tables import Column, Table, TableCell

__all__ = ["show_verdict"]

FIRST = 5
"""Sentences of a column that are shown at once; a page of them hides the numbers below."""

SENTENCES = {
    "pass": "Every check on validation motion holds.",
    "fail": "Not every check on validation motion holds.",
    "not judged": "Nothing was kept to judge the model on.",
}


def show_verdict(material: PageData) -> Section:
    """The verdict with the numbers that it rests on."""
    verdict = str(material.validation["verdict"])
    content = {
        "verdict": verdict,
        "sentence": SENTENCES.get(verdict, ""),
        "judgement": judge_trust(material),
        "first": FIRST,
        "figures": _figures(material),
        "commands": commands_of(material),
    }
    rows = [
        (
            TableCell(each["name"]),
            TableCell(short(_number(each["value"])), _number(each["value"])),
            TableCell(short(_number(each["bound"])), _number(each["bound"])),
            TableCell("holds" if each["ok"] else "fails", kind="" if each["ok"] else "poor"),
        )
        for each in material.validation["checks"]
    ]
    columns = (Column("check", words=True), Column("value"), Column("bound"), Column("", words=True))
    table = Table("checks", "What the verdict is made of", columns, rows, folded=True)
    return Section("Verdict", content, (table,) if rows else ())


def _figures(material: PageData) -> list[tuple[str, str, str]]:
    """The few numbers that say most: number, unit, what it is."""
    fit, unit = material.run.estimate.fit, effort_unit(material)
    figures: list[tuple[str, str, str]] = []
    error = "RMS error, root of the sum over joints" if len(material.joints) > 1 else "RMS error"
    held_out = material.validation_rms()
    if np.isfinite(held_out).any():
        figures.append((short(float(np.linalg.norm(held_out[np.isfinite(held_out)]))), unit, f"validation {error}"))
    training = float(np.linalg.norm(fit.residual_rms))
    figures.append((short(training), unit, f"training {error}"))
    coverage = material.validation_column("coverage95")
    if np.isfinite(coverage).any():
        figures.append((share(float(np.nanmean(coverage))), "", "of held-out rows inside 95 % bands"))
    low, high = material.run.estimate.intervals.T
    clear = int(np.sum((low > 0.0) | (high < 0.0)))
    figures.append((f"{clear} of {len(fit.names)}", "", "parameters clear of zero"))
    return figures


def _number(value: float | None) -> float:
    return np.nan if value is None else float(value)
