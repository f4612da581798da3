"""HTML page on the study of the thesis: chapters in order, and writer of the folder with the page and its tables."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path

from armid.atomic_file import replace_file
from armid.report.page import assemble, require_extra
from armid.report.section import Section
from armid.study.storage.atomic_folder import whole_folder
from armid.study.storage.records import to_json
from armid.thesis.page.estimation import show_parameters, show_steps, show_torque
from armid.thesis.page.model import show_base, show_dynamics, show_kinematics
from armid.thesis.page.motion import show_excitation
from armid.thesis.page.residual import show_residual
from armid.thesis.page.summary_and_errata import (
    show_audit,
    show_errata,
    show_provenance,
    show_references,
    show_summary,
)
from armid.thesis.reproduction import Thesis, thesis_record

__all__ = ["CHAPTERS", "KIND", "MARKER", "PAGE", "render_thesis", "thesis_sections", "write_thesis"]

MARKER, PAGE, KIND = "thesis.json", "thesis.html", "study of the thesis"

CHAPTERS: Mapping[str, Callable[[Thesis], Section]] = {
    "summary": show_summary,
    "kinematics": show_kinematics,
    "dynamics": show_dynamics,
    "base": show_base,
    "motion": show_excitation,
    "steps": show_steps,
    "parameters": show_parameters,
    "torque": show_torque,
    "residual": show_residual,
    "audit": show_audit,
    "errata": show_errata,
    "provenance": show_provenance,
    "references": show_references,
}
"""Functions that make the chapters of the page, by name, in the order of the page."""


def thesis_sections(thesis: Thesis) -> dict[str, Section]:
    """Chapters of the page for given results of the study, by name."""
    return {name: show(thesis) for name, show in CHAPTERS.items()}


def render_thesis(sections: Mapping[str, Section]) -> str:
    """HTML text of the page with given chapters."""
    subtitle = "Identification of the dynamic parameters of the KUKA LBR iiwa R820: reproduced, corrected, assessed"
    return assemble("The thesis retold", subtitle, sections, with_plots=True)


def write_thesis(thesis: Thesis, folder: Path | str) -> Path:
    """Writes `thesis.html`, `thesis.json`, and every table as CSV and LaTeX.

    Args:
        thesis: Results of the study.
        folder: Target folder; either all files are written or none.

    Raises:
        MissingExtraError: jinja2 or plotly is not installed.
        OutputError: The folder cannot be written, or has other content.
    """
    require_extra()
    sections = thesis_sections(thesis)
    with whole_folder(folder, MARKER, KIND) as draft:
        replace_file(draft / MARKER, to_json(thesis_record(thesis)) + "\n")
        replace_file(draft / PAGE, render_thesis(sections))
        (draft / "tables").mkdir()
        for table in (table for section in sections.values() for table in section.tables):
            replace_file(draft / "tables" / f"{table.key}.csv", table.csv())
            replace_file(draft / "tables" / f"{table.key}.tex", table.latex())
    return Path(folder)
