"""Page of a servo result: verdict, errors, motion, parameters and provenance, in one file that needs no network."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path

from armid.notebook_display import names_apart
from armid.report.data.number_format import short
from armid.report.data.study_toml import servo_study_to_toml
from armid.report.heading import Heading, date_text
from armid.report.page import assemble
from armid.report.page_file import write_html
from armid.report.plots.arm_picture import skeleton
from armid.report.rendering import require_extra
from armid.report.section import Section
from armid.report.sections.provenance import findings_of, page_versions
from armid.report.servos.motion import motion_section
from armid.report.servos.page_data import ServoPageData
from armid.report.servos.tables import errors_section, parameters_section
from armid.report.servos.verdict import verdict_section
from armid.report.tables import Column, Table, TableCell

POSES = 200
"""Number of poses of each run among which the pose of the picture is chosen."""


def write_servo_page(page_data: ServoPageData, path: Path | str) -> Path:
    """Writes the page of a servo result.

    Args:
        page_data: The result, with its recordings if they are available.
        path: The file; it is written completely or not at all.

    Raises:
        MissingExtraError: jinja2 or plotly is not installed.
        OutputError: The file is not an HTML page, or cannot be written.
    """
    require_extra()
    return write_html(path, render_servo(page_data))


def render_servo(page_data: ServoPageData) -> str:
    """HTML of the page of a servo result."""
    stored = page_data.stored
    sections = {name: section for name, show in SERVO.items() if (section := show(page_data)) is not None}
    subtitle = f"{len(stored.values)} parameters of {len(page_data.joints)} joints, from commands and positions"
    return assemble(
        f"{stored.robot.name}: servos, friction and links",
        subtitle,
        sections,
        with_plots=any(section.plots for section in sections.values()),
        heading=_heading(page_data),
    )


def _heading(page_data: ServoPageData) -> Heading:
    """Time and place of the identification, recordings, folder, and a picture of the arm."""
    stored, made = page_data.stored, page_data.stored.made
    when = date_text(made.at) if made.at else "date not recorded"
    where, program = f" on {made.host}" if made.host else "", f", armid {made.version}" if made.version else ""
    facts = [("identified", f"{when}{where}{program}, in {short(stored.seconds, 2)} s")]
    names = names_apart(each.path for each in stored.study.recordings)
    for role, title in (("train", "trained on"), ("validate", "validated on")):
        listed = [names[each.path] for each in stored.study.recordings if each.role == role]
        facts.append((title, ", ".join(listed) or "–"))
    facts.append(("folder", stored.folder))
    if not page_data.runs:
        return Heading(tuple(facts))
    run = max(page_data.runs, key=lambda each: each.samples)
    picture = skeleton(stored.robot, run.q[:: max(1, run.samples // POSES)])
    return Heading(tuple(facts), picture, f"{stored.robot.name} in a pose of a recording")


def provenance_section(page_data: ServoPageData) -> Section:
    """Section of inputs, versions, findings and study."""
    stored = page_data.stored
    inputs = [("description", stored.robot.sha256)]
    inputs += [
        (f"{choice.role}: {choice.path}", sha256)
        for choice, sha256 in zip(stored.study.recordings, stored.digests, strict=True)
    ]
    rows = [(TableCell(what, kind="path"), TableCell(sha256, kind="digest")) for what, sha256 in inputs]
    columns = Column("input", words=True), Column("sha256", words=True)
    table = Table("provenance", "Inputs, by their sha256", columns, rows, folded=True)
    terms = ", ".join(stored.study.servo.terms)
    content = {
        "made": [("friction", terms), ("time", f"{stored.seconds:.2f} s"), *page_versions()],
        "study": servo_study_to_toml(stored.study),
        "folder": stored.study.folder,
        "findings": findings_of(stored.findings),
    }
    return Section("Provenance", content, (table,))


SERVO: Mapping[str, Callable[[ServoPageData], Section | None]] = {
    "verdict": verdict_section,
    "errors": errors_section,
    "servo-motion": motion_section,
    "servo-parameters": parameters_section,
    "provenance": provenance_section,
}
"""Sections of the page, by the names of their templates."""
