"""Preparation of an export: which parameters are written, and how they are distributed among bodies."""

from __future__ import annotations

import math
from collections.abc import Generator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Any, TypedDict, Unpack

from armid.checked_array import Array
from armid.errors import Finding, OutputError
from armid.excitation.limits.joint_limits import with_limits
from armid.export.body_split import carried_by, carriers, share_out
from armid.export.catalogue import Exporter
from armid.export.plausibility import far_bodies, refuse_unidentified, refuse_unphysical, unphysical_names
from armid.export.standard_values import values_to_write
from armid.export.types import Body, Content, DescriptionSource
from armid.export.verification import places_of
from armid.remedy import Remedy
from armid.robot.robot import InertialParameters, Link, Robot
from armid.runs.run import Run


class ExportChoices(TypedDict, total=False):
    """Choices of the content of an export; each may be left out.

    Attributes:
        limits: Limits for a new file, if the description has none. A key contains the name of a joint, which may be a
            pattern, and `velocity`, `effort` or `position`; limits of position are a lower and an upper limit.
        nearest: True to write, of all links with the estimated base parameters, those nearest to the description.
        lumped: True to give the whole inertia of a link to its main body, and none to the attached bodies.
        allow_unphysical: True if physically inconsistent links may be written.
        allow_unidentified: True if links may be written whose mass neither the torque nor the description determines.
    """

    limits: Mapping[tuple[str, str], float | tuple[float, float]] | None
    nearest: bool
    lumped: bool
    allow_unphysical: bool
    allow_unidentified: bool


@dataclass(frozen=True, eq=False, slots=True)
class PreparedExport:
    """Content of an export, before an exporter makes a file of it.

    Attributes:
        content: Content of the file.
        theta: Standard parameters that are written, shape (p,).
        kind: Kind of the standard parameters: `estimated`, `nearest` or `unphysical`.
        findings: Findings about the parameters and their distribution among bodies.
        far: Findings about bodies far from the description.
        is_unphysical: True if physically inconsistent links are written.
    """

    content: Content
    theta: Array
    kind: str
    findings: tuple[Finding, ...]
    far: tuple[Finding, ...]
    is_unphysical: bool


def prepare(
    run: Run,
    exporter: Exporter,
    source: DescriptionSource,
    *,
    edits: bool,
    **choices: Unpack[ExportChoices],
) -> PreparedExport:
    """Chooses the parameters that are written, and distributes them among the bodies of the description.

    Args:
        run: The run.
        exporter: Exporter of the format.
        source: Description of the run.
        edits: True if the description is edited; false for a new file.
        choices: Choices of the content.

    Raises:
        OutputError: An option has no effect, limits are missing, or links must not be written.
    """
    limits, lumped = choices.get("limits"), choices.get("lumped", False)
    allow_unphysical = choices.get("allow_unphysical", False)
    bodies = _bodies(exporter, source, run.robot) if edits else None
    _refuse_options(source, limits, bodies, lumped=lumped)
    placeless = set[int]() if bodies is None else set(range(run.robot.n)) - {body.link for body in bodies}
    carried = carried_by([] if lumped else bodies or [], run.robot.n)
    robot = with_limits(run.robot, limits or {})
    with _beside(exporter.missing_limits(robot) if bodies is None else None):
        theta, kind, findings = values_to_write(
            run, placeless, carried, nearest=choices.get("nearest", False), allow_unphysical=allow_unphysical
        )
        guessed = refuse_unidentified(run, theta, placeless, allowed=choices.get("allow_unidentified", False))
        content, shared = _content(run, exporter, theta, source, bodies, robot, lumped=lumped)
        unphysical = unphysical_names(content, placeless, bodies or ())
        refused = refuse_unphysical(run, unphysical, allowed=allow_unphysical)
    known = _limits_given(run.robot, robot) if bodies is None else source.findings
    far = far_bodies(run, content, None if lumped or bodies is None else carriers(bodies), kind, shared)
    findings = (*known, *findings, *guessed, *shared, *refused)
    return PreparedExport(content, theta, kind, findings, tuple(far), bool(unphysical))


def contents_of(
    run: Run,
    exporter: Exporter,
    source: DescriptionSource,
    draws: Array,
    *,
    edits: bool,
    **choices: Unpack[ExportChoices],
) -> Generator[Content]:
    """Yields the content of a file for each vector of standard parameters, distributed among bodies as in `prepare`.

    Args:
        run: The run.
        exporter: Exporter of the format.
        source: Description of the run.
        draws: Standard parameters, shape (N, p).
        edits: True if the description is edited; false for a new file.
        choices: Choices of the content.

    Raises:
        OutputError: The description has no body for a link, or its bodies cannot have the inertias of a vector.
    """
    lumped = choices.get("lumped", False)
    robot = with_limits(run.robot, choices.get("limits") or {})
    bodies = _bodies(exporter, source, run.robot) if edits else None
    placeless = set[int]() if bodies is None else set(range(run.robot.n)) - {body.link for body in bodies}
    if placeless:
        names = ", ".join(run.robot.links[k].name for k in sorted(placeless))
        raise OutputError(
            f"An ensemble cannot be written into copies of {source.path}, because this description has no body for "
            f"these links: {names}.",
            remedy="choose another format with --to, for which a new file is written.",
        )
    for theta in draws:
        content, _ = _content(run, exporter, theta, source, bodies, robot, lumped=lumped)
        if unphysical := unphysical_names(content, placeless, bodies or ()):
            raise OutputError(
                "With the inertias of a draw, these bodies of the description would not be physically consistent: "
                f"{', '.join(unphysical)}.",
                remedy="write each link as one body with --lumped, or choose another format with --to.",
            )
        yield content


@contextmanager
def _beside(missing: OutputError | None) -> Generator[None]:
    """Context that adds missing limits to an error raised inside it, so that one message names all missing data."""
    try:
        yield
    except OutputError as error:
        if missing is None:
            raise
        raise OutputError(
            f"{error.problem} {missing.problem}",
            possible="; ".join(part for part in (error.possible, missing.possible) if part),
            remedy=Remedy(*Remedy.read(error.remedy).parts, f" In addition, {missing.remedy}"),
        ) from error


def _content(
    run: Run,
    exporter: Exporter,
    theta: Array,
    source: DescriptionSource,
    bodies: Sequence[Body] | None,
    robot: Robot,
    *,
    lumped: bool,
) -> tuple[Content, tuple[Finding, ...]]:
    """Content for the exporter, and findings about the distribution of inertia among bodies of the description."""
    robot = _identified(run, robot, theta)
    joints = {
        name: {term: value for term, value in values.items() if term in exporter.PLACES}
        for name, values in places_of(run.model, theta).items()
    }
    content = Content(robot, joints)
    if bodies is None:
        return content, ()
    links = [link.inertial or InertialParameters.zero() for link in robot.links]
    changed, findings = share_out(links, bodies, lumped=lumped)
    return replace(content, source=source, bodies=changed), findings


def _refuse_options(
    source: DescriptionSource, limits: Mapping[tuple[str, str], Any] | None, bodies: object, *, lumped: bool
) -> None:
    """Refuses options that have no effect: limits for an edited description, and `lumped` for a new file."""
    if limits and bodies is not None:
        raise OutputError(
            "Limits can be given only for a new file, but here the description "
            f"{source.path} is edited, and its limits are kept.",
            remedy="change the limits in the description.",
        )
    if lumped and bodies is None:
        raise OutputError(
            "The option --lumped has no effect on a new file, which has one body for each link.",
            remedy="leave out --lumped.",
        )


def _limits_given(described: Robot, written: Robot) -> list[Finding]:
    """Finding that names the limits that were given with an option, because the description lacks them."""
    given = [
        f"{old.name}.{kind} = {after:g}"
        for old, new in zip(described.joints, written.joints, strict=True)
        for kind, before, after in (
            ("lower", old.position_limits[0], new.position_limits[0]),
            ("upper", old.position_limits[1], new.position_limits[1]),
            ("velocity", old.velocity_limit, new.velocity_limit),
            ("effort", old.effort_limit, new.effort_limit),
        )
        if math.isfinite(after) and not math.isfinite(before)
    ]
    if not given:
        return []
    what = f"these limits were given with --limit and are not in the description: {', '.join(given)}"
    return [Finding("limits-given", "info", "", what, "check these limits against the data sheet of the arm.")]


def _bodies(exporter: Exporter, source: DescriptionSource, robot: Robot) -> list[Body]:
    return exporter.bodies(source, exporter.read(source.data, source.locked), robot)


def _identified(run: Run, robot: Robot, theta: Array) -> Robot:
    """Arm whose links have the inertias of the standard parameters `theta`."""
    vectors = theta[run.model.inertial_columns].reshape(-1, 10)
    links = [
        Link(link.name, InertialParameters.from_vector(vector))
        for link, vector in zip(robot.links, vectors, strict=True)
    ]
    return replace(robot, links=tuple(links))
