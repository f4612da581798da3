"""Catalogue of the formats of robot descriptions: one module and one line for each."""

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
    """Suffixes of its files, in lower case, with the dot."""

    @staticmethod
    def recognises(text: str) -> bool:
        """Tests whether a text looks like this format, for formats with the same suffix."""
        ...

    @staticmethod
    def read(text: str, *, source: str, locked: Mapping[str, float], tip: str | None) -> Robot:
        """Reads the robot that a text describes.

        Joints named in `locked` that have one degree of freedom stay joints of the result; others are made fixed.
        """
        ...

    @staticmethod
    def outline(text: str, *, source: str) -> JointOutline:
        """Outline of all joints, also those of several degrees of freedom and those that follow others."""
        ...


READERS: Mapping[str, DescriptionReader] = {
    "urdf": urdf,
    "mjcf": mjcf,
    "xacro": xacro,
    "dh": dh,
}
