"""A run's model as a robot description: put together, checked, and only then written."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from armid.codegen import LANGUAGES
from armid.errors import Finding, OutputError, did_you_mean
from armid.export.bodies import carried_by, is_possible, is_thin, share_out
from armid.export.check import Prediction, places_of, verify, without_place
from armid.export.content import Body, Content, Source
from armid.export.formats import EXPORTERS, Exporter
from armid.export.side import side_record
from armid.export.source import find_source, unseen_recordings
from armid.export.standard import values_to_write
from armid.robot.robot import InertialParameters, Link, Robot
from armid.study.plausibility import far_masses
from armid.study.records import finding_record, to_json
from armid.study.run import Run
from armid.validation.predict import Check
from armid.values import Array, replace_file

__all__ = ["Exported", "export_record", "export_run"]

SIDE = ".armid.json"


@dataclass(frozen=True, eq=False, slots=True)
class Exported:
    """What an export has written.

    Attributes:
        path: The robot description.
        side: The whole model, beside it.
        format: Its format.
        edited: Path of the description that was edited; empty for a file of its own.
        standard: What the parameters are: `estimated`, `nearest` or `unphysical`.
        checks: What reading the file back showed.
        predictions: Errors on unseen motion.
        findings: What was done, and what the format cannot say.
    """

    path: Path
    side: Path
    format: str
    edited: str
    standard: str
    checks: tuple[Check, ...]
    predictions: tuple[Prediction, ...]
    findings: tuple[Finding, ...]


def export_run(
    run: Run,
    to: str,
    out: Path | str | None = None,
    *,
    description: Path | str | None = None,
    data: Path | str | None = None,
    nearest: bool = False,
    allow_unphysical: bool = False,
) -> Exported:
    """Write a run's model as a robot description, and the whole model beside it.

    A description of the same format is edited: the numbers that were identified are replaced and every other byte
    stays. Otherwise the file is one of its own, with bodies without shape.

    Args:
        run: The run.
        to: Format: `urdf`, `mjcf` or `sdf`.
        out: The file; in the run's folder if left out.
        description: Where the run's description lies now, if it was moved.
        data: Where the run's recordings lie now, if they were moved.
        nearest: Share mass between the links as the description does, as far as the base values leave it open.
        allow_unphysical: Write links that no real body has, too.

    Raises:
        OutputError: The file cannot be written, or would not say what was identified; nothing is left behind.
    """
    exporter = _exporter(to)
    source = find_source(run, description)
    path = Path(out) if out is not None else _default(run, source, exporter)
    side = path.with_name(f"{path.stem}{SIDE}")
    _refuse_source(path, source)
    bodies = _bodies(exporter, source, run.robot) if exporter.EDITS and source.format == to else None
    placeless = set[int]() if bodies is None else set(range(run.robot.n)) - {body.link for body in bodies}
    theta, kind, findings = values_to_write(
        run, placeless, carried_by(bodies or [], run.robot.n), nearest=nearest, allow_unphysical=allow_unphysical
    )
    content, shared = _content(run, exporter, theta, source, bodies)
    findings = (*source.findings, *findings, *shared) if bodies is not None else findings
    unphysical = _unphysical(content, placeless, bodies or ())
    if unphysical and not allow_unphysical:
        raise _no_body(run, unphysical)
    if unphysical:
        what = f"no real body has what was identified of {', '.join(unphysical)}"
        findings = (*findings, Finding("unphysical", "warning", "", what))
    written = exporter.write(content)
    verified = verify(
        exporter, written, content, run, theta, unseen_recordings(run, data), unphysical=bool(unphysical)
    )
    record = side_record(run, content, theta, written.data, path.name, kind)
    _write_both(path, written.data, side, to_json(record) + "\n")
    far = _far(run, content, bodies, kind)
    findings = (*findings, *far, *written.findings, *_not_placed(run, exporter), *verified.findings)
    edited = "" if bodies is None else source.path
    return Exported(path, side, to, edited, kind, verified.checks, verified.predictions, findings)


def _no_body(run: Run, names: Sequence[str]) -> OutputError:
    """The error for links, bodies and joints that cannot be."""
    again = 'identify again with method = "physical".'
    other = "correct these in the description, or write a file of another format."
    return OutputError(
        f"No real body has what was identified of {', '.join(names)}.",
        possible="--allow-unphysical writes it all the same; simulators may refuse it",
        remedy=again if run.estimate.fit.standard is None else other,
    )


def _exporter(to: str) -> Exporter:
    """The writer of a format."""
    if to not in EXPORTERS:
        raise OutputError(
            f"Unknown format {to!r}.",
            possible=", ".join((*EXPORTERS, *LANGUAGES)),
            remedy=did_you_mean(to, (*EXPORTERS, *LANGUAGES)),
        )
    return EXPORTERS[to]


def _content(
    run: Run, exporter: Exporter, theta: Array, source: Source, bodies: Sequence[Body] | None
) -> tuple[Content, tuple[Finding, ...]]:
    """What is to be written, and how it was shared out among the bodies of a description."""
    robot = _identified(run, theta)
    joints = {
        name: {term: value for term, value in values.items() if term in exporter.PLACES}
        for name, values in places_of(run.model, theta).items()
    }
    content = Content(robot, joints)
    if bodies is None:
        return content, ()
    changed, findings = share_out([link.inertial or InertialParameters.zero() for link in robot.links], bodies)
    return replace(content, source=source, bodies=changed), findings


def export_record(exported: Exported) -> dict[str, Any]:
    """The contents of `export --json`."""
    return {
        "file": str(exported.path),
        "side": str(exported.side),
        "format": exported.format,
        "edited": exported.edited or None,
        "standard_parameters": exported.standard,
        "checks": [{"name": c.name, "value": c.value, "bound": c.bound, "ok": c.ok} for c in exported.checks],
        "unseen": [{"path": p.path, "rms_estimate": p.estimate, "rms_file": p.file} for p in exported.predictions],
        "findings": [finding_record(finding) for finding in exported.findings],
    }


def _default(run: Run, source: Source, exporter: Exporter) -> Path:
    """A file in the run's folder, named after the description or the arm."""
    stem = Path(source.path).stem if source.format != "dh" else run.robot.name
    return Path(run.folder) / (re.sub(r"[^\w.+-]+", "-", stem).strip(".-") + exporter.SUFFIX)


def _refuse_source(path: Path, source: Source) -> None:
    """Refuse to write over the description."""
    if any(path.exists() and path.samefile(part) for part in source.files):
        raise OutputError(f"{path} is the description itself, or a part of it.", remedy="name another with --out.")


def _bodies(exporter: Exporter, source: Source, robot: Robot) -> list[Body]:
    return exporter.bodies(source, exporter.read(source.data, source.locked), robot)


def _identified(run: Run, theta: Array) -> Robot:
    """The arm with the identified inertia on its links."""
    vectors = theta[run.model.inertial_columns].reshape(-1, 10)
    links = [
        Link(link.name, InertialParameters.from_vector(vector))
        for link, vector in zip(run.robot.links, vectors, strict=True)
    ]
    return replace(run.robot, links=tuple(links))


def _unphysical(content: Content, placeless: set[int], bodies: Sequence[Body]) -> list[str]:
    """Names of links, bodies and joints that cannot be, unless the description has them so."""
    links = {link.name: link.inertial for k, link in enumerate(content.robot.links) if k not in placeless}
    changed = content.bodies or {}
    thin = {each.name for each in bodies if each.name in changed and is_thin(each, changed[each.name])}
    own = {name: body for name, body in changed.items() if name not in thin}
    written: Mapping[str, InertialParameters | None] = {**links, **own}
    names = [name for name, body in written.items() if body is None or not (is_possible(body) or _is_nothing(body))]
    empty = [name for name, body in links.items() if body is None or _is_nothing(body)]
    negative = [
        f"the {term} parameter of {joint}"
        for joint, values in content.joints.items()
        for term, value in values.items()
        if value < 0.0
    ]
    return [*dict.fromkeys([*names, *empty]), *negative]


def _far(run: Run, content: Content, bodies: Sequence[Body] | None, kind: str) -> list[Finding]:
    """A word on bodies of the file whose mass has nothing to do with the description's."""
    written = content.bodies or {}
    if bodies is None:
        pairs = [
            (new.name, new.inertial, old.inertial)
            for new, old in zip(content.robot.links, run.robot.links, strict=True)
        ]
    else:
        pairs = [(body.name, written[body.name], body.nominal) for body in bodies if body.name in written]
    known = [(name, new.mass, old.mass) for name, new, old in pairs if new is not None and old is not None]
    if not known:
        return []
    names, found, described = zip(*known, strict=True)
    said = far_masses(names, np.array(found), np.array(described))
    if not said:
        return []
    what = f"{said} in the file: torques do not tell these masses apart from others. Torque is the same"
    remedy = (
        'identify with physical = { prior = "log-det" } in [estimation] of a study, which keeps near the description'
    )
    if kind == "estimated":
        remedy = f"--nearest writes the bodies nearest to the description with the same torque; or {remedy}"
    return [Finding("mass-far-from-description", "warning", "", what, remedy)]


def _is_nothing(body: InertialParameters) -> bool:
    return not np.any(body.vector)


def _not_placed(run: Run, exporter: Exporter) -> list[Finding]:
    """What stands in the side file alone."""
    findings: list[Finding] = []
    for term, names in without_place(run.model, exporter.PLACES).items():
        what = f"the format has no place for {', '.join(names)}; the side file has them"
        severe = term == "rotor-inertia"
        findings.append(Finding("no-place", "warning" if severe else "info", term, what))
    if any("[" in name for name in run.estimate.fit.names):
        what = "friction was estimated for each recording; its mean is written"
        findings.append(Finding("friction-averaged", "info", "", what))
    for use in run.estimate.terms:
        if use.name == "coulomb" and use.shapes.get("width"):
            what = f"friction turns over {use.shapes['width']} rad/s (m/s) in the model; the file says its size alone"
            findings.append(Finding("no-place", "info", use.name, what))
    return findings


def _write_both(path: Path, data: bytes, side: Path, record: str) -> None:
    """Both files, or neither."""
    before = side.read_bytes() if side.is_file() else None
    replace_file(side, record)
    try:
        replace_file(path, data)
    except OutputError:
        if before is None:
            side.unlink(missing_ok=True)
        else:
            replace_file(side, before)
        raise
