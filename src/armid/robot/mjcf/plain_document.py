"""Conversion of an MJCF to a plain form.

The conversion resolves includes and default classes, converts angles to radians, computes inertias from geoms and
meshes, splits bodies with several joints into bodies with one joint each, and puts all bodies below one root body.
Other programs read the plain form correctly, too: the parser of Pinocchio, with which written files are checked,
ignores includes, gravity, all trees except the first, disabled limits and some forms of orientation, and assumes a
unit mass where an inertia must be computed from a mesh.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Mapping
from dataclasses import dataclass, field
from itertools import count
from pathlib import Path

import numpy as np

from armid.checked_array import Array
from armid.errors import Finding, RobotError
from armid.maths.inertia import com_inertia_to_vector, vector_to_com_inertia
from armid.robot.described_drive import DescribedDrive, drive_of
from armid.robot.described_limits import DescribedLimits, limits_of
from armid.robot.mjcf.geom_inertia import heavy_geoms, inertia_of_geoms, is_solid, stated_mass
from armid.robot.mjcf.joints import check_equalities, joints_of
from armid.robot.mjcf.mesh_assets import MeshAssets, mesh_assets
from armid.robot.mjcf.mesh_reading import UncomputableError
from armid.robot.mjcf.poses import placement_of
from armid.robot.mjcf.settings import POSE, Settings, settings_of
from armid.robot.robot import EARTH_GRAVITY
from armid.robot.xml import floating, identity_only, numbers, parse_xml

REFUSED_ELEMENTS = ("frame", "replicate", "composite", "flexcomp", "attach")
IGNORED_COMPILER = ("boundmass", "boundinertia", "balanceinertia", "settotalmass")
ACTUATORS = ("general", "motor", "position", "velocity", "intvelocity", "damper", "cylinder", "muscle", "adhesion")
INERTIAL = {"mass": 1, "diaginertia": 3, "fullinertia": 6}
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
            try:
                included = parse_xml(path.read_text(encoding="utf-8"), str(path))
            except (OSError, UnicodeDecodeError) as error:
                raise RobotError(
                    f"{source} includes {path}, which cannot be read ({error}).",
                    remedy="put the file at the included path, or merge the files into one.",
                ) from error
            expand(included)
            element[index : index + 1] = list(included)

    expand(root)
    unnamed = count()
    for body in root.iter("body"):
        name = body.get("name") or f"body_{next(unnamed)}"
        body.set("name", name)
        for k, joint in enumerate(joints_of(body)):
            joint.set("name", joint.get("name") or f"{name}_joint_{k}")
    return root


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
    passed_over = check_equalities(root, source, locked)
    settings = settings_of(root, source)
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
    gravity = EARTH_GRAVITY
    for option in root.findall("option"):
        gravity = tuple(numbers(option, "gravity", 3, source, "option") or gravity)
    writer.add_actuator_limits(root)
    limits: dict[str, DescribedLimits] = {}
    drives: dict[str, DescribedDrive] = {}
    for name, (position, effort, turns, drives[name]) in writer.stated.items():
        limits[name], finding = limits_of(name, position=position, velocity=0.0, effort=effort, turns=turns)
        if finding is not None:
            writer.findings.append(finding)
    geoms, sites = (tuple(each for each in writer.placed if each[1].tag == tag) for tag in ("geom", "site"))
    return Plain(
        plain,
        limits,
        gravity,
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
        ignored = [key for key in IGNORED_COMPILER if key in self.settings.compiler]
        if ignored:
            self.findings.append(
                Finding(
                    "description-ignored",
                    "warning",
                    "",
                    f"the compiler settings {', '.join(ignored)} are ignored, although they change masses or "
                    "inertias",
                    "write the changed masses and inertias into the bodies, and remove these settings",
                )
            )

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
            rest = {key: value for key, value in plain.attrib.items() if key not in (*POSE, "euler", "axisangle")}
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
        position = numbers(joint, "range", 2, self.source, where)
        unstated = "false" if self.settings.compiler.get("autolimits") == "false" else "true"
        if joint.get("limited", "auto").replace("auto", unstated) == "false":
            position = None
        if position is not None and turns:
            position = self.settings.radians(position)
        force = numbers(joint, "actuatorfrcrange", 2, self.source, where)
        effort = min(map(abs, force)) if force and joint.get("actuatorfrclimited") != "false" else 0.0
        if name in self.stated:
            raise RobotError(f"{self.source} has two joints named {name!r}.", remedy="give each joint its own name.")
        drive = drive_of(joint, DRIVE, self.source, where)
        self.stated[name] = ((position[0], position[1]) if position else None, effort, turns, drive)
        return ET.Element("joint", {"name": name, "type": kind, **plain})

    def _mass(self, body: ET.Element, childclass: str, name: str) -> list[ET.Element]:
        """Element <inertial> of a body, or the geoms from which the inertia follows; the inertia is stored."""
        source_of_mass = self.settings.compiler.get("inertiafromgeom", "auto")
        inertial = body.find("inertial")
        if inertial is not None and source_of_mass != "true":
            where = f"the inertial of {name!r}"
            kept = self.settings.checked(inertial, INERTIAL, where)
            if "mass" not in kept:
                raise RobotError(f"{self.source}: {where} has no mass.", remedy="add the attribute mass [kg].")
            plain = ET.Element("inertial", {**kept, **self.settings.pose(inertial, where)})
            self.inertias[name] = _stated_inertia(plain)
            return [plain]
        heavy = heavy_geoms(body, childclass, self.settings) if source_of_mass != "false" else []
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
        return [_inertial(self.inertias[name])]

    def _geom(self, geom: ET.Element, where: str) -> ET.Element:
        """Primitive geom with the attributes that determine its mass and inertia."""
        sizes = {"size": len(geom.get("size", "").split())}
        kept = self.settings.checked(geom, {**GEOM, **sizes}, where)
        return ET.Element("geom", {"type": geom.get("type", "sphere"), **kept, **self.settings.pose(geom, where)})

    def add_actuator_limits(self, root: ET.Element) -> None:
        """Adds the effort limits of actuators to the joints that have no effort limit in the description."""
        for element in (a for section in root.findall("actuator") for a in section if a.tag in ACTUATORS):
            actuator = self.settings.resolved(element, "main")
            name = actuator.get("joint", "")
            if name not in self.stated or self.stated[name][1]:
                continue
            actuator.set("gear", (actuator.get("gear") or "1").split()[0])
            gear = numbers(actuator, "gear", 1, self.source, f"the actuator of {name!r}")
            # The control of a motor is its force; that of other actuators is not.
            keys = ("forcerange", "ctrlrange") if actuator.tag == "motor" else ("forcerange",)
            ranges = [r for k in keys if (r := numbers(actuator, k, 2, self.source, f"the actuator of {name!r}"))]
            if ranges:
                position, _, turns, drive = self.stated[name]
                effort = abs((gear or [1.0])[0]) * min(map(abs, ranges[0]))
                self.stated[name] = (position, effort, turns, drive)


def _stated_inertia(inertial: ET.Element) -> Array:
    """Ten inertial parameters (10,) in the frame of the body, from an element <inertial> in plain form."""

    def given(key: str) -> list[float]:
        return [float(word) for word in inertial.get(key, "").split()]

    (mass,) = given("mass")
    about_com = np.diag(given("diaginertia") or [0.0] * 3)
    if "fullinertia" in inertial.attrib:
        xx, yy, zz, xy, xz, yz = given("fullinertia")
        about_com = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    pose = placement_of(inertial)
    turned = pose[:3, :3] @ about_com @ pose[:3, :3].T
    return com_inertia_to_vector(mass, pose[:3, 3], turned)


def _inertial(vector: Array) -> ET.Element:
    """Element <inertial> for ten inertial parameters (10,) in the frame of the body, in full precision."""
    mass, com, inertia = vector_to_com_inertia(vector)
    full = [inertia[i, j] for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))]
    texts = {"mass": [mass], "pos": com, "fullinertia": full}
    return ET.Element("inertial", {key: " ".join(repr(float(x)) for x in xs) for key, xs in texts.items()})
