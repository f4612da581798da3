"""Input and output of an exporter: an arm with identified bodies, and what its joints have beside."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from armid.errors import Finding, OutputError
from armid.maths.inertia import vector_to_com_inertia
from armid.maths.spatial import rotation_z
from armid.robot.robot import InertialParameters, Robot
from armid.values import Array

__all__ = [
    "PLACED",
    "Body",
    "Content",
    "DescriptionSource",
    "Witness",
    "WrittenDescription",
    "com_form",
    "rpy_of",
    "text_of",
    "unique_names",
]

PLACED = ("viscous", "coulomb", "rotor-inertia")
"""Terms for whose parameter some format has a place."""


@dataclass(frozen=True, eq=False, slots=True)
class DescriptionSource:
    """The description that a run was made from.

    Attributes:
        path: Where it lies; of a built-in arm its name.
        format: `urdf`, `mjcf` or `dh`.
        data: Its text; xacro is expanded and included files are put in place.
        locked: Joints held still, with positions [rad or m].
        files: Files that the text came from.
        findings: What was done to get this text.
    """

    path: str
    format: str
    data: bytes
    locked: Mapping[str, float]
    files: tuple[str, ...] = ()
    findings: tuple[Finding, ...] = ()


@dataclass(frozen=True, eq=False, slots=True)
class Body:
    """A body of a description, as far as it moves with a link of the arm.

    Attributes:
        name: Its name in the file.
        link: Index of the link that it is part of.
        placement: Its frame in the link's frame, shape (4, 4).
        nominal: What the file says of its inertia, in its own frame; `None` where it says nothing.
        is_welded: Whether it stands on a locked joint rather than on fixed ones.
        is_guessed: Whether other programs would make its inertia from meshes.
    """

    name: str
    link: int
    placement: Array
    nominal: InertialParameters | None
    is_welded: bool = False
    is_guessed: bool = False


@dataclass(frozen=True, eq=False, slots=True)
class Content:
    """Content to be written.

    Attributes:
        robot: The arm, each link with its identified inertia.
        joints: For each joint the parameters that a format may have a place for, by the name of their term.
        source: The description to edit; `None` for a file of its own.
        bodies: The description's bodies with the inertia that each is to have, in its own frame.
    """

    robot: Robot
    joints: Mapping[str, Mapping[str, float]]
    source: DescriptionSource | None = None
    bodies: Mapping[str, InertialParameters] | None = None

    @property
    def locked(self) -> Mapping[str, float]:
        """Joints of the file that are held still."""
        return {} if self.source is None else self.source.locked


@dataclass(frozen=True, eq=False, slots=True)
class WrittenDescription:
    """A file's content.

    Attributes:
        data: Its bytes.
        findings: What the format could not hold.
    """

    data: bytes
    findings: tuple[Finding, ...] = ()


@dataclass(frozen=True, eq=False, slots=True)
class Witness:
    """Content that a program reads from a written file.

    Attributes:
        name: The program.
        torque: Torque of its rigid bodies along the states it was given, shape (N, n) [N·m or N]; `None` where the
            program does not take the file.
        joints: Parameters that it found beside, by joint and term.
        reason: Why it does not take the file.
        is_absent: Whether there is no such program here.
    """

    name: str
    torque: Array | None
    joints: Mapping[str, Mapping[str, float]]
    reason: str = ""
    is_absent: bool = False


def text_of(*numbers: float) -> str:
    """Numbers that read back as they are: up to seventeen digits."""
    return " ".join(repr(float(x) + 0.0) for x in numbers)


def com_form(body: InertialParameters, name: str) -> tuple[float, Array, Array]:
    """Mass, centre of mass and inertia about it (3, 3), as formats want them.

    Raises:
        OutputError: A body without mass, but with a moment or an inertia: no centre of mass stands for that.
    """
    if body.mass == 0.0:
        if body.vector.any():
            raise OutputError(
                f"{name} has no mass, but an inertia; a file cannot say this.",
                remedy='identify with method = "physical".',
            )
        return 0.0, np.zeros(3), np.zeros((3, 3))
    return vector_to_com_inertia(body.vector)


def rpy_of(rotation: Array) -> tuple[float, float, float]:
    """Roll, pitch and yaw [rad] with Rz(yaw) Ry(pitch) Rx(roll) = R (3, 3)."""
    yaw = math.atan2(rotation[1, 0], rotation[0, 0])
    # Near a pitch of 90° the yaw is any; what it leaves is well determined whatever it is.
    rest = rotation_z(-yaw) @ rotation
    return math.atan2(-rest[1, 2], rest[1, 1]), math.atan2(-rest[2, 0], rest[0, 0]), yaw


def unique_names(names: Sequence[str], taken: Sequence[str] = ()) -> list[str]:
    """The names, those that occur twice or are taken with a number behind."""
    used = set(taken)
    result: list[str] = []
    for name in names:
        wanted, k = name, 1
        while wanted in used:
            k += 1
            wanted = f"{name}_{k}"
        used.add(wanted)
        result.append(wanted)
    return result
