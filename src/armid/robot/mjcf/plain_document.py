"""Conversion of an MJCF to a plain form.

The conversion resolves includes and default classes, converts angles to radians, computes inertias from geoms and
meshes, splits bodies with several joints into bodies with one joint each, and puts all bodies below one root body.
Other programs read the plain form correctly, too: the parser of Pinocchio, with which written files are checked,
ignores includes, gravity, all trees except the first, disabled limits and some forms of orientation, and assumes a
unit mass where an inertia must be computed from a mesh.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import count
from pathlib import Path

from armid.checked_array import Array
from armid.errors import Finding, RobotError
from armid.input_boundary import read_text
from armid.robot.described_drive import DescribedDrive, drive_of, negative_drive
from armid.robot.described_limits import DescribedLimits, limits_of
from armid.robot.mjcf.force_limits import actuator_efforts, range_in_effect
from armid.robot.mjcf.geom_inertia import heavy_geoms, inertia_of_geoms, is_solid, stated_mass
from armid.robot.mjcf.joints import check_equalities, joints_of
from armid.robot.mjcf.mesh_assets import MeshAssets, mesh_assets
from armid.robot.mjcf.mesh_reading import UncomputableError
from armid.robot.mjcf.position_servos import with_position_servos
from armid.robot.mjcf.settings import ORIENTATIONS, Settings, settings_of
from armid.robot.mjcf.stated_inertia import inertial_of, plain_inertial, stated_inertia
from armid.robot.mjcf.unmodelled import ignored_parts, ignored_settings
from armid.robot.packages import refuse_outside
from armid.robot.robot import EARTH_GRAVITY
from armid.robot.xml import floating, identity_only, numbers, parse_xml

REFUSED_ELEMENTS = ("frame", "replicate", "composite", "flexcomp", "attach")
DRIVE = {"rotor_inertia": "armature", "viscous": "damping", "coulomb": "frictionloss"}
"""Attributes of a joint for the values of `DescribedDrive`."""
GEOM = {"fromto": 6, "mass": 1, "density": 1}


@dataclass(frozen=True, slots=True)
class Uncomputed:
    """Inertia of a body that could not be computed.

    Attributes:
        mass: Sum of the masses that are stated for the geoms [kg]; `None` if a mass must be computed from a volume.
        reason: Reason why the inertia could not be computed, for messages.
    """

    mass: float | None
    reason: str


@dataclass(slots=True)
class Plain:
    """MJCF in plain form.

    Attributes:
        root: The converted document.
        limits: Limits of the joints, by name.
        gravity: Acceleration of gravity [m/s²].
        findings: Findings of the conversion.
        geoms: Every geom with the attributes of its defaults and a pose in plain form, together with the name of its
            body, which is empty for the world.
        sites: Named sites, in the same form as `geoms`. They are not in `root`, because Pinocchio misplaces sites of
            fixed bodies.
        uncomputed: Bodies whose inertia must be computed from geoms, but could not be computed.
        inertias: Inertial parameters (10,) of bodies in their own frames, by name; bodies without inertia are not
            contained.
        drives: Rotor inertia and friction of the joints, by name.
        meshes: Meshes of the document.
    """

    root: ET.Element
    limits: dict[str, DescribedLimits]
    gravity: tuple[float, ...]
    findings: tuple[Finding, ...]
    geoms: tuple[tuple[str, ET.Element], ...] = ()
    sites: tuple[tuple[str, ET.Element], ...] = ()
    uncomputed: Mapping[str, Uncomputed] = field(default_factory=dict[str, Uncomputed])
    inertias: Mapping[str, Array] = field(default_factory=dict[str, Array])
    drives: Mapping[str, DescribedDrive] = field(default_factory=dict[str, DescribedDrive])
    meshes: MeshAssets | None = None

    @property
    def text(self) -> str:
        """Text of the converted document."""
        return ET.tostring(self.root, encoding="unicode")


def flatten(root: ET.Element, source: str) -> ET.Element:
    """Inserts included files into a document and names unnamed bodies and joints; it changes the given element.

    Raises:
        RobotError: An included file cannot be read or is included twice.
    """
    folder, seen = Path(source).parent, set[Path]()

    def expand(element: ET.Element) -> None:
        for index, child in reversed(list(enumerate(element))):
            if child.tag != "include":
                expand(child)
                continue
            path = folder / child.get("file", "")
            if path in seen:
                raise RobotError(f"{source} includes {path} more than once.", remedy="include each file only once.")
            seen.add(path)
            refuse_outside(path, source)
            remedy = "put the file at the included path, or merge the files into one."
            included = parse_xml(read_text(path, f"a part of {source}", RobotError, remedy=remedy), str(path))
            expand(included)
            element[index : index + 1] = list(included)

    expand(root)
    bodies = [(body, body.get("name", ""), joints_of(body)) for body in root.iter("body")]
    given = [(name, [joint.get("name", "") for joint in joints]) for _, name, joints in bodies]
    for (body, _, joints), (name, names) in zip(bodies, named(given), strict=True):
        body.set("name", name)
        for joint, own in zip(joints, names, strict=True):
            joint.set("name", own)
    return root


def named(bodies: Sequence[tuple[str, Sequence[str]]]) -> list[tuple[str, list[str]]]:
    """Names of bodies and their joints, with free names `body_0`, … and `BODY_joint_0`, … in place of empty ones.

    Args:
        bodies: Names of each body and of its joints in the order of the document; empty for those without a name.
    """
    taken = {name for name, _ in bodies}
    taken_joints = {name for _, joints in bodies for name in joints}
    numbered = (name for k in count() if (name := f"body_{k}") not in taken)
    result: list[tuple[str, list[str]]] = []
    for own, joints in bodies:
        name, names = own or next(numbered), list[str]()
        for k, joint in enumerate(joints):
            free = (each for i in count(k) if (each := f"{name}_joint_{i}") not in taken_joints)
            names.append(joint or next(free))
            taken_joints.add(names[-1])
        result.append((name, names))
    return result


def plain_mjcf(root: ET.Element, source: str, locked: Mapping[str, float], *, folder: Path | None = None) -> Plain:
    """Converts a flattened document to its plain form.

    Args:
        root: The document.
        source: Path of the document.
        locked: Joints to be locked; locked joints with several degrees of freedom are not in the result.
        folder: Folder in which meshes are searched; that of the document if not given.

    Raises:
        RobotError: An element has no plain form, or a joint with several degrees of freedom is not locked.
    """
    for element in root.iter():
        if element.tag in REFUSED_ELEMENTS:
            raise RobotError(
                f"{source} uses <{element.tag}>, which armid cannot read.",
                remedy="load the file in MuJoCo, save it with mj_saveLastXML, and give the saved file.",
            )
    settings = settings_of(root, source)
    passed_over = check_equalities(root, settings, locked)
    meshes = mesh_assets(root, settings, Path(source).resolve().parent if folder is None else folder)
    writer = _Writer(source, locked, settings, meshes)
    writer.findings += passed_over
    plain = ET.Element("mujoco", model=root.get("model") or "robot")
    ET.SubElement(plain, "compiler", angle="radian")
    world = ET.SubElement(ET.SubElement(plain, "worldbody"), "body", name="world")
    for worldbody in root.findall("worldbody"):
        childclass = worldbody.get("childclass", "main")
        writer.keep_geoms("", worldbody, childclass)
        for body in worldbody.findall("body"):
            world.append(writer.body(body, childclass))
    writer.findings += ignored_parts(root, settings)
    for name, effort in actuator_efforts(root, settings, writer.findings):
        if name in writer.stated and not writer.stated[name][1]:
            writer.stated[name] = (writer.stated[name][0], effort, *writer.stated[name][2:])
    limits: dict[str, DescribedLimits] = {}
    drives: dict[str, DescribedDrive] = {}
    for name, (position, effort, turns, drives[name]) in writer.stated.items():
        limits[name], finding = limits_of(name, position=position, velocity=0.0, effort=effort, turns=turns)
        if finding is not None:
            writer.findings.append(finding)
    drives = with_position_servos(drives, root, settings)
    geoms, sites = (tuple(each for each in writer.placed if each[1].tag == tag) for tag in ("geom", "site"))
    return Plain(
        plain,
        limits,
        _gravity(root, source),
        tuple(writer.findings),
        geoms,
        sites,
        uncomputed=writer.uncomputed,
        inertias=writer.inertias,
        drives=drives,
        meshes=meshes,
    )


@dataclass(slots=True)
class _Writer:
    """Conversion of bodies to plain form; it also collects the limits of their joints."""

    source: str
    locked: Mapping[str, float]
    settings: Settings
    meshes: MeshAssets
    stated: dict[str, tuple[tuple[float, float] | None, float, bool, DescribedDrive]] = field(default_factory=dict)
    findings: list[Finding] = field(default_factory=list)
    bodies: set[str] = field(default_factory=lambda: {"world"})
    placed: list[tuple[str, ET.Element]] = field(default_factory=list[tuple[str, ET.Element]])
    uncomputed: dict[str, Uncomputed] = field(default_factory=dict[str, Uncomputed])
    inertias: dict[str, Array] = field(default_factory=dict[str, Array])

    def __post_init__(self) -> None:
        self.findings += ignored_settings(self.settings)

    def body(self, body: ET.Element, childclass: str) -> ET.Element:
        """Converts a body with its subtree; a body with several joints becomes a chain with massless bodies."""
        childclass = body.get("childclass", childclass)
        name = body.get("name", "")
        if name in self.bodies:
            raise RobotError(f"{self.source} has two bodies named {name!r}.", remedy="give each body its own name.")
        self.bodies.add(name)
        read = (self._joint(self.settings.resolved(joint, childclass)) for joint in joints_of(body))
        joints = [joint for joint in read if joint is not None]
        outer = inner = ET.Element("body", self.settings.pose(body, f"body {name!r}"))
        for joint in joints[:-1]:
            inner.set("name", f"{name} after {joint.get('name')}")
            inner.append(joint)
            inner = ET.SubElement(inner, "body")
        inner.set("name", name)
        inner.extend(joints[-1:])
        inner.extend(self._mass(body, childclass, name))
        self.keep_geoms(name, body, childclass)
        for site in body.findall("site"):
            site = self.settings.resolved(site, childclass)
            if site.get("name"):
                pose = self.settings.pose(site, "a site")
                self.placed.append((name, ET.Element("site", {"name": site.get("name", ""), **pose})))
        for child in body.findall("body"):
            inner.append(self.body(child, childclass))
        return outer

    def keep_geoms(self, name: str, body: ET.Element, childclass: str) -> None:
        """Stores the visual and collision geoms of a body, with their defaults."""
        for geom in body.findall("geom"):
            plain = self.settings.resolved(geom, childclass)
            pose = self.settings.pose(plain, f"a geom of {name or 'the world'!r}")
            rest = {key: value for key, value in plain.attrib.items() if key not in ("pos", *ORIENTATIONS)}
            self.placed.append((name, ET.Element("geom", {**rest, **pose})))

    def _joint(self, joint: ET.Element) -> ET.Element | None:
        """Hinge or slide joint in plain form; `None` for a locked joint with several degrees of freedom."""
        name = joint.get("name", "")
        kind = "free" if joint.tag == "freejoint" else joint.get("type", "hinge")
        if kind not in ("hinge", "slide"):
            if name in self.locked:
                identity_only(name, kind, self.locked[name])
                return None
            raise floating(self.source, name, kind, "hinge, slide")
        where, turns = f"joint {name!r}", kind == "hinge"
        if not any(numbers(joint, "axis", 3, self.source, where) or [1.0]):
            raise RobotError(
                f"{self.source}: {where} has an axis of zero length.", remedy="give the direction of the axis."
            )
        plain = self.settings.checked(joint, {"axis": 3, "pos": 3}, where)
        reference = numbers(joint, "ref", 1, self.source, where)
        if reference is not None:
            plain["ref"] = repr((self.settings.radians(reference) if turns else reference)[0])
        position = range_in_effect(joint, "range", self.settings, where, self.findings)
        if position is not None and turns:
            position = self.settings.radians(position)
        force = range_in_effect(joint, "actuatorfrcrange", self.settings, where, self.findings)
        effort = min(map(abs, force)) if force else 0.0
        if name in self.stated:
            raise RobotError(f"{self.source} has two joints named {name!r}.", remedy="give each joint its own name.")
        drive = drive_of(joint, DRIVE, self.source, where)
        self.findings += negative_drive(name, joint, DRIVE)
        self.stated[name] = ((position[0], position[1]) if position else None, effort, turns, drive)
        return ET.Element("joint", {"name": name, "type": kind, **plain})

    def _mass(self, body: ET.Element, childclass: str, name: str) -> list[ET.Element]:
        """Element <inertial> of a body, or the geoms from which the inertia follows; the inertia is stored."""
        source_of_mass = self.settings.compiler.get("inertiafromgeom", "auto")
        inertial = plain_inertial(body, self.settings, name)
        computes = source_of_mass == "true" or (source_of_mass != "false" and inertial is None)
        heavy = heavy_geoms(body, childclass, self.settings) if computes else []
        if inertial is not None and not heavy:  # MuJoCo keeps it, too, if no geom has a mass
            self.inertias[name] = stated_inertia(inertial)
            return [inertial]
        where = f"a geom of {name!r}"
        if not heavy:
            return []
        try:
            self.inertias[name] = inertia_of_geoms(heavy, self.meshes, self.settings, where)
        except UncomputableError as error:
            self.uncomputed[name] = Uncomputed(stated_mass(heavy, self.settings), error.problem)
            return []
        if all(is_solid(geom) for geom in heavy):
            return [self._geom(geom, where) for geom in heavy]  # so other programs compute the inertia anew
        return [inertial_of(self.inertias[name])]

    def _geom(self, geom: ET.Element, where: str) -> ET.Element:
        """Primitive geom with the attributes that determine its mass and inertia."""
        sizes = {"size": len(geom.get("size", "").split())}
        kept = self.settings.checked(geom, {**GEOM, **sizes}, where)
        return ET.Element("geom", {"type": geom.get("type", "sphere"), **kept, **self.settings.pose(geom, where)})


def _gravity(root: ET.Element, source: str) -> tuple[float, ...]:
    """Acceleration of gravity [m/s²]; zero if it is switched off."""
    gravity, state = EARTH_GRAVITY, "enable"
    for option in root.findall("option"):
        gravity = tuple(numbers(option, "gravity", 3, source, "option") or gravity)
        for flag in option.findall("flag"):
            state = flag.get("gravity", state)
    return gravity if state != "disable" else (0.0, 0.0, 0.0)
