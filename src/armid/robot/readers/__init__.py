"""Catalogue of the formats of robot descriptions; each format has one module and one line here."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Protocol

from armid.robot.joint_selection import JointOutline
from armid.robot.readers import dh, mjcf, urdf, xacro
from armid.robot.robot import Robot

__all__ = ["READERS", "DescriptionReader"]


class DescriptionReader(Protocol):
    """Interface of a reader module."""

    SUFFIXES: tuple[str, ...]
    """Suffixes of the files of this format, in lower case, with the dot."""

    @staticmethod
    def recognises(text: str) -> bool:
        """Tests whether a text looks like this format; it is used if several formats have the same suffix."""
        ...

    @staticmethod
    def read(text: str, *, source: str, locked: Mapping[str, float], tip: str | None) -> Robot:
        """Reads the robot that a text describes.

        Joints named in `locked` that have one degree of freedom are still joints of the result; other ones are made
        fixed.
        """
        ...

    @staticmethod
    def outline(text: str, *, source: str) -> JointOutline:
        """Reads the list of all joints of a description and the tree that they form.

        The list includes joints with more than one degree of freedom and joints whose position depends on another
        joint (mimic joints).
        """
        ...


READERS: Mapping[str, DescriptionReader] = {
    "urdf": urdf,
    "mjcf": mjcf,
    "xacro": xacro,
    "dh": dh,
}
