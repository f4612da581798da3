"""Head of a run's page: when and where it was made, from which recordings, and a picture of the arm."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path

from armid.notebook import names_apart
from armid.report.data.number_format import short
from armid.report.data.page_data import PageData
from armid.report.plots.arm_picture import picture_of

__all__ = ["Heading", "commands_of", "heading_of_run"]

MOST_RECORDINGS = 4
"""Recordings of a role that are named at the top; the provenance has them all."""

NEXT = (
    ("export {run} --to urdf", "write the model back; --to mjcf, sdf, or source code: c, cpp, python …"),
    ("validate {run} RECORDING", "the error on another recording"),
    ("preview {run}", "a page on which the arm moves through a recording of this run"),
    ("certify {run}", "physical consistency and the mass matrix in the worst pose"),
)
"""What to do with a run, and what it gives."""


@dataclass(frozen=True, slots=True)
class Heading:
    """Marks beside a page's title.

    Attributes:
        facts: What, and its value.
        picture: A picture as SVG; empty where there is none.
        caption: What it shows.
    """

    facts: Sequence[tuple[str, str]] = ()
    picture: str = ""
    caption: str = ""


def heading_of_run(material: PageData) -> Heading:
    """The head of a run's page."""
    run, estimate = material.run, material.run.estimate
    made = run.made
    when = _date(made.at) if made.at else "date not recorded"
    where = f" on {made.host}" if made.host else ""
    by = f", armid {made.version}" if made.version else ""
    facts = [("identified", f"{when}{where}{by}, in {short(estimate.seconds, 2)} s")]
    for role, what in (("train", "trained on"), ("validate", "validated on")):
        facts.append((what, _recordings(material, role) or "–"))
    facts.append(("run", run.folder))
    picture, caption = picture_of(material)
    return Heading(tuple(facts), picture, caption)


def commands_of(material: PageData) -> list[tuple[str, str]]:
    """Commands for a run with its own path, and what they give."""
    run = shlex.quote(str(Path(material.run.folder)))
    return [(f"armid {command.format(run=run)}", what) for command, what in NEXT]


def _recordings(material: PageData, role: str) -> str:
    """Names of the recordings of a role, with their lengths where they are at hand."""
    names = names_apart(each["path"] for each in material.study["recordings"])
    lengths = {
        (each.choice.path, each.choice.part): f" ({short(float(each.time[-1]))} s)"
        for each in material.of_role(role)
        if each.is_consecutive
    }
    said = [
        names[each["path"]] + lengths.get((each["path"], tuple(each["part"])), "")
        for each in material.study["recordings"]
        if each["role"] == role
    ]
    more = f" and {len(said) - MOST_RECORDINGS} more" if len(said) > MOST_RECORDINGS + 1 else ""
    return ", ".join(said[:MOST_RECORDINGS] if more else said) + more


def _date(at: str) -> str:
    """A date as people read it, for instance 3 May 2025, 14:07 (UTC+02:00); as it is where it is no date."""
    try:
        when = datetime.fromisoformat(at)
    except ValueError:
        return at
    return f"{when.day} {when:%B %Y, %H:%M} ({when.tzname() or 'local time'})"
