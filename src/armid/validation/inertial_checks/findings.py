"""Findings about bodies of a description whose stated inertia does not agree with their shapes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from armid.errors import Finding
from armid.robot.described_bodies.body import DescribedBody
from armid.robot.described_bodies.reading import described_bodies
from armid.robot.robot import Robot
from armid.validation.inertial_checks.causes import InertialMistake, about_origin, unit_mistake
from armid.validation.inertial_checks.copies import copied, is_placeholder
from armid.validation.inertial_checks.filled_shape import FilledShape, filled_shape
from armid.validation.inertial_checks.measures import HEAVIEST, LARGEST, LIGHTEST, SMALLEST, Measures, measures_of

ROUNDING = 1e-3
"""Largest absolute value of a negative principal second moment, divided by the largest one, that counts as a rounding
error of printed digits."""

NAMED = 6
"""Largest number of bodies that one finding lists."""

COMPUTE = "compute the inertia of this body from its shape or CAD."

TORQUE = "torque and simulation with this body are wrong"


@dataclass(frozen=True, eq=False, slots=True)
class InertialCheck:
    """Comparison of the stated inertia of the bodies of a description with their shapes.

    Attributes:
        bodies: Number of bodies that the joints move and that have a mass.
        measures: Comparison of each body that has readable shapes, by name.
        unread: Files of meshes that are missing or cannot be read, by the name of the body.
        without_shapes: Names of the bodies that have no solid shape.
        named: Names of the bodies about which there is a warning.
        findings: Findings about the bodies.
    """

    bodies: int
    measures: Mapping[str, Measures]
    unread: Mapping[str, tuple[str, ...]]
    without_shapes: tuple[str, ...]
    named: tuple[str, ...]
    findings: tuple[Finding, ...]


def check_inertials(robot: Robot, *, packages: Mapping[str, str] | None = None) -> InertialCheck:
    """Compares the inertia that the description of an arm states with the shapes of its bodies.

    Args:
        robot: The arm, whose description is read again.
        packages: Folders of ROS packages by name, as in `load_robot`.

    Raises:
        RobotError: The description cannot be read any more.
    """
    found = check_bodies(described_bodies(robot, packages=packages))
    if all(joint.drive.rotor_inertia == 0.0 for joint in robot.joints):
        return replace(found, findings=(*found.findings, _no_rotors(robot)))
    return found


def check_bodies(bodies: Sequence[DescribedBody]) -> InertialCheck:
    """Compares the stated inertia of bodies with their shapes.

    Args:
        bodies: Bodies of one arm.
    """
    shapes: dict[str, FilledShape] = {}
    unread: dict[str, tuple[str, ...]] = {}
    bare: list[str] = []
    for body in bodies:
        shape, lost = filled_shape(body)
        if lost:
            unread[body.name] = lost
        if shape is None:
            bare += [body.name] * (not lost)
        elif not lost:  # with a part of the shapes, a sound body would seem to be outside
            shapes[body.name] = shape
    measures = {body.name: measures_of(body, shapes[body.name]) for body in bodies if body.name in shapes}
    groups = copied(bodies, shapes)
    alone = {body.name: _body_findings(body, shapes, measures) for body in bodies}
    findings = [finding for of_body in alone.values() for finding in of_body]
    findings += [_copy_finding(group) for group in groups]
    findings += _not_examined(unread, bare)
    wrong = {*(name for name, own in alone.items() if own), *(body.name for group in groups for body in group)}
    named = tuple(body.name for body in bodies if body.name in wrong)
    return InertialCheck(len(bodies), measures, unread, tuple(bare), named, tuple(findings))


def _body_findings(
    body: DescribedBody, shapes: Mapping[str, FilledShape], measures: Mapping[str, Measures]
) -> list[Finding]:
    """Findings about one body.

    An impossible inertia tensor is reported alone. Otherwise a cause that explains all numbers is reported. If there
    is none, each number outside its bounds is reported.

    Args:
        body: The body.
        shapes: Hulls of the shapes, by the name of the body.
        measures: Comparison of the bodies with these hulls, by the name of the body.
    """
    if (impossible := _impossible(body)) is not None:
        return [impossible]
    if body.name not in shapes:
        return []
    shape, own = shapes[body.name], measures[body.name]
    if is_placeholder(body, shape, own.ratio):
        rest = [] if own.is_inside and own.is_dense_enough else _numbers(body, own, inertia=False)
        return [_placeholder(body, own), *rest]
    cause = about_origin(body, shape, own)
    if cause is None and not own.is_sound:
        cause = unit_mistake(body, shape)
    if cause is not None:
        return [_explained(body, own, cause)]
    return _numbers(body, own, inertia=True)


def _impossible(body: DescribedBody) -> Finding | None:
    """Finding that no real body can have the mass and inertia tensor of a body; `None` if they are possible."""
    values = np.linalg.eigvalsh(0.5 * np.trace(body.inertia) * np.eye(3) - body.inertia)
    if body.mass > 0.0 and values[0] >= -ROUNDING * max(abs(values[-1]), np.finfo(float).tiny):
        return None
    moments = ", ".join(f"{x:.3g}" for x in np.linalg.eigvalsh(body.inertia))
    evidence = (
        f"no body has a mass of {body.mass:.4g} kg and the principal moments of inertia {moments} kg·m²: mass and "
        "moments are positive, and none is larger than the sum of the other two; simulators refuse or change it"
    )
    return Finding(
        "inertia-impossible",
        "warning",
        body.name,
        evidence,
        COMPUTE,
    )


def _state(own: Measures) -> str:
    """Clause of a finding with density, centre of mass and inertia of a body relative to its hull."""
    place = "inside its hull" if own.is_inside else f"{own.outside:.3g} m outside its hull"
    return (
        f"the mass fills the hull of its shapes with {own.density:.3g} kg/m³, the centre of mass lies {place}, and "
        f"the inertia is {own.ratio:.3g} times that of the filled hull"
    )


def _explained(body: DescribedBody, own: Measures, cause: InertialMistake) -> Finding:
    """Finding with the mistake that explains all numbers of a body.

    Args:
        body: The body.
        own: Comparison of the body with its hull.
        cause: The mistake.
    """
    evidence = f"{cause.words[0].upper()}{cause.words[1:]}: {_state(own)}; {TORQUE}"
    return Finding(cause.code, "warning", body.name, evidence, f"{cause.remedy}.")


def _placeholder(body: DescribedBody, own: Measures) -> Finding:
    """Finding that the inertia of a body is a placeholder."""
    moment = body.inertia[0, 0]
    what = f"the same about all axes ({moment:.3g} kg·m²), but its shape is not round" if moment else "zero"
    if moment and not 0.2 <= own.ratio <= 5.0:
        what = f"the same about all axes ({moment:.3g} kg·m²), {own.ratio:.3g} times that of the filled hull"
    evidence = f"the inertia looks like a placeholder: it is {what}; {TORQUE} in fast motion"
    return Finding(
        "inertial-placeholder",
        "warning",
        body.name,
        evidence,
        COMPUTE,
    )


def _numbers(body: DescribedBody, own: Measures, *, inertia: bool) -> list[Finding]:
    """Findings about each number of a body that is outside its bounds, if no mistake explains them.

    Args:
        body: The body.
        own: Comparison of the body with its hull.
        inertia: False to leave out findings about the inertia.
    """
    found: list[tuple[str, str, str]] = []
    if not own.is_dense_enough:
        bound = f"more than {HEAVIEST:g}, as tungsten has" if own.density > HEAVIEST else f"less than {LIGHTEST:g}"
        evidence = f"a mass of {body.mass:.4g} kg fills the hull of its shapes with {own.density:.3g} kg/m³, {bound}"
        found.append(("density-implausible", evidence, "check its mass, and the scale of its meshes"))
    if not own.is_inside:
        evidence = (
            f"the centre of mass lies {own.outside:.3g} m outside the hull of its shapes, of which up to "
            f"{own.margin:.2g} m could be parts that are not drawn"
        )
        found.append(("com-outside-hull", evidence, "check the origin of its inertial, its sign and its frame"))
    if inertia and own.reach > LARGEST:
        evidence = (
            f"the inertia is {own.ratio:.3g} times that of the filled hull, and {own.reach:.3g} times the largest "
            "that a body of this mass inside the hull can have along one axis"
        )
        found.append(("inertia-too-large", evidence, "check the inertia of this body and its axes"))
    elif inertia and own.ratio < SMALLEST:
        evidence = f"the inertia is {own.ratio:.3g} times that of the filled hull, as if the mass were in one point"
        found.append(("inertia-too-small", evidence, "check the inertia of this body"))
    return [Finding(code, "warning", body.name, f"{text}; {TORQUE}", f"{remedy}.") for code, text, remedy in found]


def _copy_finding(group: Sequence[DescribedBody]) -> Finding:
    """Finding that bodies with different shapes have the same mass and inertia."""
    names = ", ".join(body.name for body in group)
    evidence = (
        f"these bodies have the same mass of {group[0].mass:.4g} kg and the same principal moments of inertia, but "
        "their shapes have different sizes, so the numbers of all but one are copied; torque with them is wrong"
    )
    return Finding("inertial-copied", "warning", names, evidence, "compute the inertia of each body by itself.")


def _not_examined(unread: Mapping[str, tuple[str, ...]], bare: Sequence[str]) -> list[Finding]:
    """Finding that names the bodies that were not compared with shapes, with the reason; empty if there are none.

    Args:
        unread: Files of meshes that cannot be read, by the name of the body.
        bare: Names of bodies without solid shapes.
    """
    parts: list[str] = []
    if unread:
        first = next(iter(unread.values()))[0]
        parts.append(
            f"{_listed(list(unread))} (meshes or other shapes that are missing or not read, such as {first})"
        )
    if bare:
        parts.append(f"{_listed(bare)} (no solid shapes)")
    if not parts:
        return []
    evidence = f"not compared with shapes: {'; '.join(parts)}"
    remedy = "name the folder of the meshes with --package NAME=DIR, or put them in place." if unread else ""
    return [Finding("shapes-not-examined", "info", "", evidence, remedy)]


def _listed(names: Sequence[str]) -> str:
    more = f" and {len(names) - NAMED} more" if len(names) > NAMED else ""
    return ", ".join(names[:NAMED]) + more


def _no_rotors(robot: Robot) -> Finding:
    """Finding that the description has no rotor inertia."""
    what = "a URDF cannot state it" if robot.source.endswith((".urdf", ".xacro")) else "no joint states it"
    evidence = (
        f"rotor inertia (armature) is missing, because {what}; behind a gear it is often as large as the inertia of "
        "the links"
    )
    remedy = "identify the arm with the term rotor-inertia, and export to a format that stores it (--to mjcf)."
    return Finding("armature-missing", "info", "", evidence, remedy)


def check_record(check: InertialCheck) -> dict[str, object]:
    """JSON object with the numbers of a comparison of bodies with their shapes, without the findings."""
    return {
        "bodies": check.bodies,
        "compared": {
            name: {
                "density": own.density,
                "com_outside_hull": own.outside,
                "inertia_ratio": own.ratio,
                "inertia_reach": own.reach,
            }
            for name, own in check.measures.items()
        },
        "unread": {name: list(files) for name, files in check.unread.items()},
        "without_shapes": list(check.without_shapes),
        "named": list(check.named),
    }
