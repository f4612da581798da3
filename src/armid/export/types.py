"""Types for the input and output of exporters: inertias, joint parameters, descriptions, and written files."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from armid.checked_array import Array
from armid.errors import Finding, OutputError
from armid.maths.inertia import vector_to_com_inertia
from armid.maths.rotations import rotation_z
from armid.remedy import Remedy, setting
from armid.robot.robot import InertialParameters, Robot


@dataclass(frozen=True, eq=False, slots=True)
class DescriptionSource:
    """Description with which a run was identified.

    Attributes:
        path: Path of the description, or name of a built-in arm.
        format: Name of the exporter that can edit the description; `dh` if no exporter can.
        data: Text of the description, with xacro expanded and included files inserted.
        locked: Positions of the locked joints [rad or m], by name.
        files: Paths of the description and of the files that it includes.
        findings: Findings about changes, such as included files, that were made to obtain the text.
    """

    path: str
    format: str
    data: bytes
    locked: Mapping[str, float]
    files: tuple[str, ...] = ()
    findings: tuple[Finding, ...] = ()


@dataclass(frozen=True, eq=False, slots=True)
class OpenedDescription:
    """Description prepared for editing.

    Attributes:
        data: Text of the description, with xacro expanded and included files inserted.
        files: Paths of the description and of the files that it includes.
        findings: Findings about changes, such as included files, that were made to obtain the text.
    """

    data: bytes
    files: tuple[str, ...]
    findings: tuple[Finding, ...] = ()


@dataclass(frozen=True, eq=False, slots=True)
class Body:
    """Body of a description that moves with a link of the arm.

    Attributes:
        name: Name of the body in the file.
        link: Index of the link to which the body belongs.
        placement: Pose of the body in the frame of the link, shape (4, 4).
        nominal: Inertia of the body in the description, in the frame of the body; `None` if the description contains
            none.
        is_welded: True if a locked joint attaches the body to its link; false if only fixed joints do, or for the
            main body.
        is_guessed: True if other programs compute the inertia of the body from meshes.
    """

    name: str
    link: int
    placement: Array
    nominal: InertialParameters | None
    is_welded: bool = False
    is_guessed: bool = False


@dataclass(frozen=True, eq=False, slots=True)
class Content:
    """Content of a file to be written.

    Attributes:
        robot: Arm whose links have the identified inertias.
        joints: Parameters that a format may store for a joint, by name of the joint and name of the term.
        source: The description to edit; `None` for a new file.
        bodies: New inertia of each body of the description, in the frame of the body; `None` for a new file.
    """

    robot: Robot
    joints: Mapping[str, Mapping[str, float]]
    source: DescriptionSource | None = None
    bodies: Mapping[str, InertialParameters] | None = None

    @property
    def locked(self) -> Mapping[str, float]:
        """Positions of the joints that are locked in the file [rad or m]; the keys are the names of the joints."""
        return {} if self.source is None else self.source.locked


@dataclass(frozen=True, eq=False, slots=True)
class WrittenDescription:
    """File content that an exporter has made, before it is verified and stored.

    Attributes:
        data: Content of the file.
        findings: Findings about values that the format cannot store.
    """

    data: bytes
    findings: tuple[Finding, ...] = ()


@dataclass(frozen=True, eq=False, slots=True)
class Witness:
    """Model that another program reads from a written file, to check the file.

    Attributes:
        name: Name of the program.
        torque: Torque of the rigid bodies at the given states, shape (N, n) [N·m or N]; `None` if the program rejects
            the file.
        joints: Parameters that the program has read for the joints, by name of the joint and name of the term.
        reason: Reason why the program rejects the file.
        is_absent: True if the program is not installed.
    """

    name: str
    torque: Array | None
    joints: Mapping[str, Mapping[str, float]]
    reason: str = ""
    is_absent: bool = False


def text_of(*numbers: float) -> str:
    """Writes numbers as text with up to seventeen digits, from which exactly the same numbers can be read."""
    return " ".join(repr(float(x) + 0.0) for x in numbers)


def plain_number(number: float) -> str:
    """Writes a number without exponent, with as many digits as are needed to read exactly the same number."""
    return np.format_float_positional(number + 0.0, trim="0")


def com_form(body: InertialParameters, name: str) -> tuple[float, Array, Array]:
    """Converts inertial parameters to mass, centre of mass (3,) and inertia about the centre of mass (3, 3).

    Raises:
        OutputError: The body has a first moment or an inertia but no mass, so it has no centre of mass.
    """
    if body.mass == 0.0:
        if body.vector.any():
            raise OutputError(
                f"The mass of {name} is zero, but its first moment or its inertia is not zero; a file cannot store "
                "this.",
                remedy=Remedy("identify again with ", setting("method", "physical"), "."),
            )
        return 0.0, np.zeros(3), np.zeros((3, 3))
    return vector_to_com_inertia(body.vector)


def rpy_of(rotation: Array) -> tuple[float, float, float]:
    """Angles roll, pitch and yaw [rad] with Rz(yaw) Ry(pitch) Rx(roll) = R, for a rotation matrix R (3, 3)."""
    yaw = math.atan2(rotation[1, 0], rotation[0, 0])
    # Near a pitch of 90° the yaw is arbitrary, but roll and pitch are well determined for any yaw.
    rest = rotation_z(-yaw) @ rotation
    return math.atan2(-rest[1, 2], rest[1, 1]), math.atan2(-rest[2, 0], rest[0, 0]), yaw


def unique_names(names: Sequence[str], taken: Sequence[str] = ()) -> list[str]:
    """Makes names unique: a number is appended to names that occur twice and to names in `taken`."""
    used = set(taken)
    result: list[str] = []
    for name in names:
        candidate, k = name, 1
        while candidate in used:
            k += 1
            candidate = f"{name}_{k}"
        used.add(candidate)
        result.append(candidate)
    return result
