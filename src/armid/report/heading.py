"""Head of a run's page: time and place of the identification, recordings, and a picture of the arm."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path

from armid.estimation.estimate_record import Estimate
from armid.model.parameter_name import ParameterName
from armid.notebook_display import names_apart
from armid.report.data.number_format import short
from armid.report.data.page_data import PageData
from armid.report.plots.arm_picture import picture_of
from armid.robot.robot import Robot

MAX_RECORDINGS = 4
"""Largest number of recordings of a role that the head of the page names; the section about provenance names all."""

EDITED = (".urdf", ".xacro", ".xml", ".mjcf")
"""Suffixes of descriptions that an export edits. For other descriptions, an export writes a new file, which may lack
limits that the format needs."""

NEXT_COMMANDS = (
    ("validate {run} RECORDING", "torque error on another recording"),
    ("preview {run}", "a page on which the arm moves through a recording of this run"),
    ("certify {run}", "physical consistency and the mass matrix in the worst pose"),
)
"""Next commands for a run, each with its result."""


@dataclass(frozen=True, slots=True)
class Heading:
    """Facts and picture at the head of a page.

    Attributes:
        facts: Name and value of each fact, such as date or recordings.
        picture: A picture as SVG; empty if there is none.
        caption: Caption of the picture.
    """

    facts: Sequence[tuple[str, str]] = ()
    picture: str = ""
    caption: str = ""


def heading_of_run(page_data: PageData) -> Heading:
    """Heading of the page of a run: time and place of the identification, recordings, folder, picture of the arm."""
    run, estimate = page_data.run, page_data.run.estimate
    origin = run.made
    when = date_text(origin.at) if origin.at else "date not recorded"
    where = f" on {origin.host}" if origin.host else ""
    program = f", armid {origin.version}" if origin.version else ""
    facts = [("identified", f"{when}{where}{program}, in {short(estimate.seconds, 2)} s")]
    for role, title in (("train", "trained on"), ("validate", "validated on")):
        facts.append((title, _recordings(page_data, role) or "–"))
    facts.append(("run", run.folder))
    picture, caption = picture_of(page_data)
    return Heading(tuple(facts), picture, caption)


def commands_of(page_data: PageData) -> list[tuple[str, str]]:
    """Commands that can follow a run, with the path of the run inserted, each with its result."""
    run = shlex.quote(str(Path(page_data.run.folder)))
    export = export_command(run, page_data.run.estimate, page_data.run.robot, page_data.study.robot.description)
    return [export, *((f"armid {command.format(run=run)}", purpose) for command, purpose in NEXT_COMMANDS)]


def export_command(run: str, estimate: Estimate, robot: Robot, description: str) -> tuple[str, str]:
    """Command that exports an estimate, and its result: a robot description if possible, otherwise source code.

    A robot description needs an estimated body of each link, and a description that an export can edit.

    Args:
        run: Path of the run, as the command line needs it.
        estimate: Estimate of the run.
        robot: Arm of the run.
        description: Path or name of the description of the arm.
    """
    suffix = Path(description).suffix
    format_name = "mjcf" if suffix in (".xml", ".mjcf") else "urdf"
    condition = limitation_of_description(estimate, robot)
    if condition:
        other = f"as a robot description (--to {format_name}): {condition}"
        return f"armid export {run} --to c", f"the model as source code; {other}"
    if suffix not in EDITED:
        return f"armid export {run} --to c", f"the model as source code; as a robot description: --to {format_name}"
    return f"armid export {run} --to {format_name}", "the model as a robot description, or code: --to c"


def limitation_of_description(estimate: Estimate, robot: Robot) -> str:
    """Text about the limitation of a robot description exported from an estimate; empty if there is none.

    There is none if the estimate contains a physically consistent body of each link.
    """
    bodies = estimate.fit.standard
    status = {} if bodies is None else dict(zip(bodies.names, bodies.status, strict=True))
    numbered = enumerate(robot.links, 1)
    massless = [(k, link.name) for k, link in numbered if link.inertial is None or link.inertial.mass <= 0.0]
    unknown = [name for k, name in massless if status.get(ParameterName("M", k)) != "identified"]
    if unknown:
        return f"needs masses of {', '.join(unknown)} in the description"
    if bodies is None or bodies.proof.smallest_eigenvalue <= 0.0 or bodies.proof.lowest < 0.0:
        nearest = "bodies nearest to the description that are consistent and have these base parameters, if any"
        return f"{nearest}; identify with --method physical to estimate bodies"
    return ""


def _recordings(page_data: PageData, role: str) -> str:
    """Names of the recordings of a role, with their lengths if they could be read."""
    names = names_apart(each.path for each in page_data.study.recordings)
    lengths = {
        (each.choice.path, each.choice.part): f" ({short(float(each.time[-1]))} s)"
        for each in page_data.of_role(role)
        if each.is_consecutive
    }
    texts = [
        names[each.path] + lengths.get((each.path, each.part), "")
        for each in page_data.study.recordings
        if each.role == role
    ]
    rest = f" and {len(texts) - MAX_RECORDINGS} more" if len(texts) > MAX_RECORDINGS + 1 else ""
    return ", ".join(texts[:MAX_RECORDINGS] if rest else texts) + rest


def date_text(at: str) -> str:
    """Date such as 3 May 2025, 14:07 (UTC+02:00); a text that is not an ISO date is returned unchanged."""
    try:
        when = datetime.fromisoformat(at)
    except ValueError:
        return at
    return f"{when.day} {when:%B %Y, %H:%M} ({when.tzname() or 'local time'})"
