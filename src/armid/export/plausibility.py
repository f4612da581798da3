"""Checks of an export for bodies that are physically inconsistent, not identified, or far from the description."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from armid.checked_array import Array
from armid.errors import Finding, OutputError
from armid.estimation.problem import standard_of
from armid.export.fixed_body_inertias import is_possible, is_thin
from armid.export.types import Body, Content
from armid.remedy import Remedy, setting
from armid.robot.missing_inertia import placeholder_masses
from armid.robot.robot import InertialParameters, Robot
from armid.runs.run import Run
from armid.study.plausibility.estimate_findings import far_masses, listed_masses

SEEN = 1e-6
"""Tolerance of the test whether base parameters determine a mass: the length of the projection of its unit vector
onto the rows of the regrouping may differ from 1 by this amount."""

AWAY = 3.0
"""Distance of a centre of mass from the described one, divided by the size of the described body, from which a body
counts as far from the description. The size is the larger of two lengths: the RMS distance of the body from the
origin of its frame, and the length of its link."""

NAMED = 4


def unphysical_names(content: Content, placeless: Collection[int], bodies: Sequence[Body]) -> list[str]:
    """Names of links, bodies and joints with physically inconsistent parameters.

    Bodies that are point masses in the description and in the file, and links without a body in the file
    (`placeless`, by index), are not named.
    """
    links = {link.name: link.inertial for k, link in enumerate(content.robot.links) if k not in placeless}
    changed = content.bodies or {}
    thin = {each.name for each in bodies if each.name in changed and is_thin(each, changed[each.name])}
    new_bodies = {name: body for name, body in changed.items() if name not in thin}
    written: Mapping[str, InertialParameters | None] = {**links, **new_bodies}
    names = [name for name, body in written.items() if body is None or not (is_possible(body) or _is_nothing(body))]
    empty = [name for name, body in links.items() if body is None or _is_nothing(body)]
    negative = [
        f"the {term} parameter of {joint}"
        for joint, values in content.joints.items()
        for term, value in values.items()
        if value < 0.0
    ]
    return [*dict.fromkeys([*names, *empty]), *negative]


def refuse_unphysical(run: Run, names: Sequence[str], *, allowed: bool) -> tuple[Finding, ...]:
    """Refuses to write physically inconsistent parameters, unless this is allowed; then a finding is returned.

    Args:
        run: The run.
        names: Names of the links, bodies and joints with inconsistent parameters.
        allowed: True if these parameters may be written.

    Raises:
        OutputError: `names` is not empty, and inconsistent parameters are not allowed.
    """
    if not names:
        return ()
    what = f"not physically consistent: {', '.join(names)}; no real body can have these parameters"
    if allowed:
        return (Finding("unphysical", "warning", "", what),)
    again = Remedy("identify again with ", setting("method", "physical"), ".")
    other = "correct these bodies in the description, or choose another format with --to."
    raise OutputError(
        f"{what[0].upper()}{what[1:]}.",
        possible="--allow-unphysical, which writes the file nevertheless; simulators may reject it",
        remedy=again if run.estimate.fit.standard is None else other,
    )


def refuse_unidentified(run: Run, theta: Array, placeless: Collection[int], *, allowed: bool) -> tuple[Finding, ...]:
    """Refuses to write links whose mass neither the torque nor the description determines, unless this is allowed.

    Links with a mass in the description are accepted, because the prior keeps their estimates near it.

    Args:
        run: The run.
        theta: Standard parameters (p,) that would be written.
        placeless: Indices of the links that have no body in the file.
        allowed: True if these links may be written; then a finding is returned.

    Raises:
        OutputError: There are links of this kind, and it is not allowed to write them.
    """
    standard = standard_of(run.model, run.estimate.base)
    columns = standard.inertial[:, 0]
    seen = _determined(run)[columns]
    guessed = [
        f"{link.name} ({theta[k]:.3g} kg)"
        for i, (link, k, is_seen) in enumerate(zip(run.robot.links, columns, seen, strict=True))
        if not is_seen and i not in placeless and (link.inertial is None or link.inertial.mass <= 0.0)
    ]
    if not guessed:
        return ()
    what = f"torques do not determine the mass of {', '.join(guessed)}, and the description gives none"
    remedy = (
        "give these links approximate masses in the description and identify again: values that the torque does not "
        "determine then stay near the description."
    )
    if not allowed:
        raise OutputError(
            f"{what[0].upper()}{what[1:]}: many values fit equally well, and the estimated values are arbitrary.",
            possible="--allow-unidentified, which writes the estimated masses; the torque in free motion is right, "
            "but single masses are not",
            remedy=remedy,
        )
    evidence = f"{what}; many values fit equally well, and the values in the file are arbitrary"
    return (Finding("unidentified", "warning", "", evidence, remedy),)


def _determined(run: Run) -> NDArray[np.bool_]:
    """Mask of the standard parameters (p,) that the torque determines.

    If the estimate has standard parameters, the mask is true for those with the status identified. Otherwise it is
    true for the standard parameters that follow from the base parameters.
    """
    standard, kept = standard_of(run.model, run.estimate.base), run.estimate.fit.standard
    if kept is not None:  # by name, since the fit has copies of friction parameters for several recordings
        status = dict(zip(kept.names, kept.status, strict=True))
        return np.array([status.get(name) == "identified" for name in standard.names], dtype=np.bool_)
    _, sizes, rows = np.linalg.svd(standard.regrouping, full_matrices=False)
    rows = rows[sizes > SEEN * sizes[0]]
    return np.linalg.norm(rows, axis=0) >= 1.0 - SEEN


def far_bodies(
    run: Run, content: Content, bodies: Sequence[Body] | None, kind: str, shared: Sequence[Finding] = ()
) -> list[Finding]:
    """Findings about bodies of the file whose mass or centre of mass is far from the value in the description.

    There is at most one finding about the bodies that the torque determines, and at most one about all other bodies.
    A body is not compared if its mass in the description is a placeholder.

    Args:
        run: The run.
        content: Content of the file.
        bodies: Bodies of the description that are compared; `None` to compare whole links.
        kind: Kind of the standard parameters: `estimated`, `nearest` or `unphysical`.
        shared: Findings about the distribution of the links' inertia among bodies.
    """
    written = content.bodies or {}
    if bodies is None:
        every = enumerate(zip(content.robot.links, run.robot.links, strict=True))
        pairs = [(i, new.name, new.inertial, old.inertial) for i, (new, old) in every]
    else:
        pairs = [(each.link, each.name, written[each.name], each.nominal) for each in bodies if each.name in written]
    compared = [(i, name, new, old) for i, name, new, old in pairs if new is not None and old is not None]
    if not compared:
        return []
    found, described = (
        np.array(each) for each in zip(*((new.mass, old.mass) for *_, new, old in compared), strict=True)
    )
    usable = ~placeholder_masses(described)
    far = far_masses(found, described) & usable
    away = [_far_com(run.robot, *each) if usable[k] else "" for k, each in enumerate(compared)]
    names = [name for _, name, *_ in compared]
    carrying = {each.channel for each in shared if each.code == "difference-taken"}
    sums = {each.channel for each in shared}  # of a link with several bodies only the sum is known
    whole = np.array([name not in sums for name in names])
    determined = _determined(run)[standard_of(run.model, run.estimate.base).inertial[[i for i, *_ in compared]]]
    of_mass, of_com = determined[:, 0] & whole, determined[:, :4].all(axis=1) & whole
    findings: list[Finding] = []
    for is_determined in (True, False):
        which = far & (of_mass == is_determined)
        outside = [k for k, text in enumerate(away) if text and of_com[k] == is_determined]
        texts = [listed_masses(names, found, described, which)] if which.any() else []
        texts += [away[k] for k in outside[:NAMED]] + ["and more"] * (len(outside) > NAMED)
        if texts:
            rest = [name for k, name in enumerate(names) if name in carrying and (which[k] or k in outside)]
            findings.append(_far_finding(run, "; ".join(texts), kind, rest, known=is_determined))
    return findings


def _far_finding(run: Run, what: str, kind: str, rest: Sequence[str], *, known: bool) -> Finding:
    """Finding about bodies that are far from the description.

    Args:
        run: The run.
        what: Text that names the bodies.
        kind: Kind of the standard parameters: `estimated`, `nearest` or `unphysical`.
        rest: Names of the main bodies among these bodies. A main body gets the inertia of its link minus the inertia
            of the attached bodies.
        known: True if the torque determines mass and centre of mass of these bodies.
    """
    if known:
        evidence = (
            f"In the exported file, {what}. The recordings determine these values. So the recordings or the "
            "description are of another arm or load, or the unit of the torque is wrong"
        )
        remedy = "check that description and recordings are of the same arm with the same load"
        return Finding("mass-far-from-description", "warning", "", evidence, remedy)
    evidence = (
        f"In the exported file, {what}. The recordings do not determine these values one by one: other values give "
        "the same torque"
    )
    nearest = "use --nearest, which writes, of all bodies that give the same torque, those nearest to the description"
    ways = [nearest] if kind == "estimated" else []
    standard = run.estimate.fit.standard
    if standard is None or standard.prior.kind != "log-det":
        near = 'physical = { prior = "log-det" } in [estimation] of a study'
        ways.append(f"identify with {near}, which keeps the estimates near the description")
    if rest:
        ways.append(f"use --lumped, which writes the whole link as one body for {', '.join(rest)}")
    ways = ways or ["if better masses are known, write them into the description and identify again"]
    return Finding("mass-far-from-description", "warning", "", evidence, "; or ".join(ways))


def _far_com(robot: Robot, link: int, name: str, new: InertialParameters, old: InertialParameters) -> str:
    """Text with the distance between new and described centre of mass of a body; empty if it is small (`AWAY`)."""
    if new.mass <= 0.0 or old.mass <= 0.0:
        return ""
    spread = float(np.sqrt(max(np.trace(old.pseudo_inertia[:3, :3]), 0.0) / old.mass))
    joints = [joint.placement[:3, 3] for joint in robot.joints if joint.parent == link]
    size = max([spread, *(float(np.linalg.norm(place)) for place in joints)])
    away = float(np.linalg.norm(new.com - old.com))
    return (
        f"the centre of mass of {name} is {away:.3g} m away from that in the description"
        if away > AWAY * size > 0.0
        else ""
    )


def _is_nothing(body: InertialParameters) -> bool:
    return not np.any(body.vector)
