"""Reader of tables of Denavit-Hartenberg (DH) parameters in TOML.

Example of a file::

    name = "my-arm"
    convention = "modified"           # standard, modified or thesis
    units = "deg"                     # of angles written as plain numbers: rad (default) or deg
    gravity = [0.0, 0.0, -9.81]       # optional, acceleration in the base frame [m/s²]

    [base]                            # optional: frame in which row 1 starts, relative to the base frame
    xyz = [0.0, 0.0, 0.1]
    rpy = [0, 0, "pi/2"]              # Rz(yaw) Ry(pitch) Rx(roll)

    [[joint]]                         # one for each joint, beginning at the base
    name = "A1"                       # default: joint_1, joint_2, …
    kind = "revolute"                 # revolute (default), continuous or prismatic
    alpha = 0                         # parameters of the row; the default is 0
    a = 0.0
    theta = 0
    d = 0.36
    position = [-170, 170]            # limits, optional; m, m/s and N for a prismatic joint
    velocity = 98
    effort = 176                      # [N·m]

    [joint.inertial]                  # optional: nominal inertia of the link
    mass = 4.0                        # [kg]
    com = [0.0, -0.03, 0.12]          # centre of mass [m], in the frame of the row
    inertia = { xx = 0.1, xy = 0.0, xz = 0.0, yy = 0.09, yz = 0.0, zz = 0.02 }   # [kg·m²] about the centre of mass

    [tip]                             # optional: frame of the flange, relative to the frame of the last row
    name = "flange"
    xyz = [0.0, 0.0, 0.045]
    rpy = [0, 0, 0]

Angles are numbers in `units`, or strings such as "pi/2", "-pi", "3*pi/4" for exact radians. Velocities of revolute
joints are in `units` per second. A link with a mass but no inertia is a point mass.

The position q is added to the angle of a revolute joint and to the length d of a prismatic one. The conventions are:

=========  ==============================================  ==============================================
standard   T = Rz(theta) Tz(d) Tx(a) Rx(alpha)             row i ends in frame i
modified   T = Rx(alpha) Tx(a) Rz(theta) Tz(d)             alpha and a are those of row i - 1 [Craig2005]
thesis     T = Ty(d_y) Tz(d_z) Rz(phi) Rx(theta) Rz(psi)   a sliding joint moves along the new z
=========  ==============================================  ==============================================

The origin of a link frame of armid is on the axis of the joint. For `modified` and `thesis`, the link frame is the
frame of the row. For `standard`, it is the frame of the row without Tx(a) Rx(alpha); this part is moved to the next
row, so that a standard table becomes the equivalent modified table. In a standard table, centres of mass and inertias
are given in the frame of the row, as manufacturers publish them, and are transformed to the link frame.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from difflib import get_close_matches
from pathlib import Path
from typing import Any, Literal, cast

import numpy as np

from armid.checked_array import Array
from armid.errors import Finding, RobotError, did_you_mean
from armid.input_boundary import parse_toml
from armid.maths.rotations import homogeneous, rotation_x, rotation_z, rpy_rotation
from armid.robot.collision_body_names import BodyName
from armid.robot.joint_selection import JointOutline, SelectedJoint
from armid.robot.robot import EARTH_GRAVITY, Frame, InertialParameters, Joint, Link, Robot
from armid.robot.shapes import Shape, capsule_between
from armid.robot.xml import check_locked

ROWS: dict[str, tuple[tuple[str, ...], tuple[str, ...]]] = {
    "standard": (("a", "d"), ("alpha", "theta")),
    "modified": (("a", "d"), ("alpha", "theta")),
    "thesis": (("d_y", "d_z"), ("phi", "theta", "psi")),
}
"""Keys of the lengths and of the angles of a row, by convention."""

TOP = ("name", "convention", "units", "gravity", "base", "joint", "tip", "capsule")
JOINT = ("name", "kind", "position", "velocity", "effort", "inertial", "capsule")
INERTIA = ("xx", "xy", "xz", "yy", "yz", "zz")

PI_EXPRESSION = re.compile(r"\s*([+-]?)\s*(?:(\d+(?:\.\d+)?)\s*\*\s*)?pi\s*(?:/\s*(\d+(?:\.\d+)?)\s*)?")


def recognises(text: str) -> bool:
    """Tests whether a text looks like a DH table."""
    return "[[joint]]" in text


def read(text: str, *, source: str, locked: Mapping[str, float], tip: str | None) -> Robot:
    """Reads the robot of a DH table.

    Args:
        text: The TOML text.
        source: Path of the table, or name of a built-in arm.
        locked: Joints to be locked; all of them are still joints of the result.
        tip: Name of the tip frame: that of the table, or a link (`link_1`, …); `None` for that of the table.

    Raises:
        RobotError: The text is not a valid DH table; the message names the wrong key and lists the possible keys.
    """
    document = parse_toml(text, source, RobotError)
    top = _Table(document, source)
    top.only(TOP)
    convention = top.choice("convention", tuple(ROWS))
    degrees = top.choice("units", ("rad", "deg"), "rad") == "deg"
    rows = [
        _Table(row, f"{source}, joint {k}", degrees, f"joint_{k}")
        for k, row in enumerate(_tables(document, "joint", source), 1)
    ]
    if not rows:
        raise RobotError(
            f"{source} has no [[joint]].", remedy="write a table [[joint]] for every joint, beginning at the base."
        )
    table = [_row(row, convention) for row in rows]
    check_locked(locked, (_name(row) for row in rows), source)

    joints: list[Joint] = []
    links: list[Link] = []
    findings: list[Finding] = []
    shapes = [*_capsules(document, source, "base", -1, np.eye(4))]
    reached = _pose(document, "base", source, degrees)  # of the row's start in the frame of the joint before
    for i, (row, (before, after)) in enumerate(zip(rows, table, strict=True)):
        joints.append(_joint(row, i - 1, reached @ before))
        inertial = _inertial(row, after, findings)
        shapes += _capsules(row.data, row.where, f"link_{i + 1}", i, after)
        links.append(Link(f"link_{i + 1}", inertial))
        reached = after
    last = reached @ _pose(document, "tip", source, degrees)
    own = Frame(_Table(document.get("tip", {}), f"{source}, [tip]").text("name", "tip"), len(joints) - 1, last)
    return Robot(
        top.text("name", Path(source).stem),
        tuple(joints),
        tuple(links),
        _tip(own, links, tip, source),
        np.array(top.vector("gravity", 3, EARTH_GRAVITY)),
        source=source,
        findings=tuple(findings),
        shapes=tuple(shapes),
    )


def outline(text: str, *, source: str) -> JointOutline:
    """Joints of a DH table; each joint is carried by the one before it.

    Raises:
        RobotError: The text is not a valid table.
    """
    robot = read(text, source=source, locked={}, tip=None)
    joints = (
        SelectedJoint(j.name, j.parent, True, float(j.position_limits[0]), float(j.position_limits[1]))
        for j in robot.joints
    )
    frames = {robot.tip.name: robot.tip.parent, **{link.name: k for k, link in enumerate(robot.links)}}
    return JointOutline(tuple(joints), frames)


def _tip(own: Frame, links: list[Link], name: str | None, source: str) -> Frame:
    """Frame of the table's tip, or of the link with the given name."""
    frames = [own, *(Frame(link.name, i, np.eye(4)) for i, link in enumerate(links))]
    for frame in frames:
        if name in (None, frame.name):
            return frame
    possible, remedy = ", ".join(f.name for f in frames), "give the name of one of these frames."
    raise RobotError(f"{source} has no frame {name!r} for the tip.", possible=possible, remedy=remedy)


def _row(row: _Table, convention: str) -> tuple[Array, Array]:
    """Transforms (4, 4) from the start of a row to its link frame, and from the link frame to the end of the row."""
    lengths, angles = ROWS[convention]
    row.only((*lengths, *angles, *JOINT))
    length = {key: row.number(key, 0.0) for key in lengths}
    angle = {key: row.angle(key) for key in angles}
    if convention == "thesis":
        turn = rotation_z(angle["phi"]) @ rotation_x(angle["theta"]) @ rotation_z(angle["psi"])
        return homogeneous(turn, [0.0, length["d_y"], length["d_z"]]), np.eye(4)
    along_z = homogeneous(rotation_z(angle["theta"]), [0.0, 0.0, length["d"]])
    along_x = homogeneous(rotation_x(angle["alpha"]), [length["a"], 0.0, 0.0])
    return (along_z, along_x) if convention == "standard" else (along_x @ along_z, np.eye(4))


def _name(row: _Table) -> str:
    """Name of the joint of a row; by default it contains the number of the row."""
    return row.text("name", row.default_name)


def _joint(row: _Table, parent: int, placement: Array) -> Joint:
    kind = cast("Literal['revolute', 'continuous', 'prismatic']", row.choice("kind", KINDS, "revolute"))
    turns = kind != "prismatic"
    position = row.vector("position", 2, (-math.inf, math.inf), angle=turns)
    name = _name(row)
    if position[0] >= position[1]:
        raise RobotError(
            f"{row.where}: the lower limit of {name!r} is not smaller than the upper limit; found "
            f"{row.data['position']}.",
            remedy="give a lower limit that is smaller than the upper one.",
        )
    if kind == "continuous" and "position" in row.data:
        raise RobotError(
            f"{row.where}: {name!r} is continuous but has position limits.",
            remedy='write kind = "revolute", or remove the limits.',
        )
    return Joint(
        name,
        kind,
        parent,
        np.array([0.0, 0.0, 1.0]),
        placement,
        np.array(position),
        row.positive("velocity", angle=turns),
        row.positive("effort"),
    )


def _capsules(data: dict[str, Any], where: str, name: str, link: int, to_end: Array) -> list[Shape]:
    """Capsules of a link, or of the base; a DH table gives them in the frame in which the row of the link ends."""
    result: list[Shape] = []
    for number, given in enumerate(_tables(data, "capsule", where), 1):
        table = _Table(given, f"{where}, capsule {number}")
        table.only(("from", "to", "radius"))
        table.require(("from", "to", "radius"))
        label = BodyName(name, number)
        body = capsule_between(label, link, table.vector("from", 3), table.vector("to", 3), table.number("radius"))
        result.append(body.on(link, to_end))
    return result


def _inertial(row: _Table, to_end: Array, findings: list[Finding]) -> InertialParameters | None:
    """Inertial parameters in the link frame; the table gives them in the frame in which the row ends."""
    data = row.data.get("inertial")
    if data is None:
        return None
    where = f"{row.where}, inertial"
    table = _Table(data, where)
    table.only(("mass", "com", "inertia"))
    table.require(("mass", "com"))
    com = np.array(table.vector("com", 3))
    tensor = np.zeros((3, 3))
    if "inertia" in table.data:
        entries = _Table(table.data["inertia"], f"{where}, inertia")
        entries.only(INERTIA)
        entries.require(INERTIA)
        xx, xy, xz, yy, yz, zz = (entries.number(key) for key in INERTIA)
        tensor = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    else:
        findings.append(
            Finding(
                "inertia-missing",
                "info",
                _name(row),
                "the link has a mass but no inertia; it is treated as a point mass",
                "if the inertia is known, give the key `inertia` in [joint.inertial]",
            )
        )
    body = InertialParameters.from_com(table.number("mass"), com, tensor)
    # Unchanged where the frames agree, so that the numbers stay those of the file.
    return body if (to_end == np.eye(4)).all() else body.seen_from(to_end[:3, :3], to_end[:3, 3])


def _pose(document: dict[str, Any], key: str, source: str, degrees: bool) -> Array:
    """Homogeneous transform (4, 4) that is given by the table [base] or [tip]."""
    table = _Table(document.get(key, {}), f"{source}, [{key}]", degrees)
    table.only(("name", "xyz", "rpy") if key == "tip" else ("xyz", "rpy"))
    rpy = table.vector("rpy", 3, (0.0, 0.0, 0.0), angle=True)
    return homogeneous(rpy_rotation(rpy), table.vector("xyz", 3, (0.0, 0.0, 0.0)))


def _tables(document: dict[str, Any], key: str, source: str) -> list[Any]:
    rows = document.get(key, [])
    if not isinstance(rows, list):
        raise RobotError(
            f"{source}: {key} must be an array of tables.",
            remedy=f"write [[{key}]], with double brackets, above the keys of each entry.",
        )
    return cast("list[Any]", rows)


KINDS = ("revolute", "continuous", "prismatic")


@dataclass(frozen=True, slots=True)
class _Table:
    """Table of a DH file in TOML; its entries are checked when they are read."""

    data: Any
    where: str
    degrees: bool = False
    default_name: str = ""

    def __post_init__(self) -> None:
        if not isinstance(self.data, dict):
            raise self.wrong("the entry", self.data, "a table")

    def wrong(self, key: str, found: object, wanted: str) -> RobotError:
        """Error for an entry that has a wrong value."""
        problem = f"{self.where}: {key} must be {wanted}; found {found!r}."
        return RobotError(problem, remedy=f"correct {key} in the table.")

    def only(self, known: tuple[str, ...]) -> None:
        """Raises an error for unknown keys."""
        for key in self.data:
            if key not in known:
                close = get_close_matches(key, known, 1)
                remedy = f"write {close[0]!r}" if close else "remove it"
                raise RobotError(
                    f"{self.where}: unknown key {key!r}.", possible=", ".join(known), remedy=f"{remedy}."
                )

    def require(self, keys: tuple[str, ...]) -> None:
        """Raises an error that names all missing keys."""
        missing = [key for key in keys if key not in self.data]
        if missing:
            verb, written = "is" if len(missing) == 1 else "are", ", ".join(f"{key} = …" for key in missing)
            raise RobotError(f"{self.where}: {', '.join(missing)} {verb} missing.", remedy=f"write {written}")

    def need(self, key: str) -> Any:
        """Value of a key; an error is raised if the key is missing."""
        self.require((key,))
        return self.data[key]

    def text(self, key: str, default: str | None = None) -> str:
        """Value of a key that must be a non-empty string."""
        value = self.data.get(key, default) if default is not None else self.need(key)
        if not isinstance(value, str) or not value:
            raise self.wrong(key, value, "a name")
        return value

    def choice(self, key: str, possible: tuple[str, ...], default: str | None = None) -> str:
        """Value of a key that must be one of several words."""
        if default is None and key not in self.data:
            remedy = f'write for instance {key} = "{possible[0]}".'
            raise RobotError(
                f"{self.where}: the key {key!r} is missing.", possible=", ".join(possible), remedy=remedy
            )
        value = self.text(key, default)
        if value not in possible:
            remedy = did_you_mean(value, possible) or f"write one of these words for {key}."
            raise RobotError(
                f"{self.where}: {key} has the unknown value {value!r}.", possible=", ".join(possible), remedy=remedy
            )
        return value

    def number(self, key: str, default: float | None = None) -> float:
        """Value of a key that must be a finite number."""
        return self._number(key, self.data.get(key, default) if default is not None else self.need(key))

    def angle(self, key: str) -> float:
        """Value of a key that must be an angle, converted to radians [rad]; 0 if the key is missing."""
        return self._angle(key, self.data.get(key, 0.0))

    def positive(self, key: str, *, angle: bool = False) -> float:
        """Value of a key that must be a positive limit; infinite if the key is missing."""
        if key not in self.data:
            return math.inf
        value = self._angle(key, self.data[key]) if angle else self.number(key)
        if value <= 0.0:
            raise self.wrong(key, self.data[key], "positive")
        return value

    def vector(
        self, key: str, length: int, default: tuple[float, ...] | None = None, *, angle: bool = False
    ) -> tuple[float, ...]:
        """Value of a key that must be a list of `length` numbers or angles."""
        if key not in self.data and default is not None:
            return default
        value = self.need(key)
        if not isinstance(value, list) or len(cast("list[Any]", value)) != length:
            raise self.wrong(key, value, f"a list of {length} {'angles' if angle else 'numbers'}")
        one = self._angle if angle else self._number
        return tuple(one(key, item) for item in cast("list[Any]", value))

    def _number(self, key: str, value: object) -> float:
        if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
            raise self.wrong(key, value, "a finite number")
        return float(value)

    def _angle(self, key: str, value: object) -> float:
        if not isinstance(value, str):
            number = self._number(key, value)
            return math.radians(number) if self.degrees else number
        match = PI_EXPRESSION.fullmatch(value)
        if match is None or (match[3] and float(match[3]) == 0.0):
            raise self.wrong(key, value, 'an angle: a number, or a multiple of pi such as "-3*pi/4"')
        sign, factor, divisor = match.groups()
        magnitude = float(factor or 1.0) * math.pi / (float(divisor) if divisor else 1.0)
        return -magnitude if sign == "-" else magnitude
