"""Catalogue of the formats of robot descriptions; each format has one module and one line here."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from importlib import import_module
from typing import Protocol, cast

from armid.robot.joint_selection import JointOutline
from armid.robot.robot import Robot

__all__ = ["READERS", "DescriptionFormat", "DescriptionReader"]


class DescriptionReader(Protocol):
    """Interface of a module that reads one format of robot descriptions."""

    @staticmethod
    def recognises(text: str) -> bool:
        """Tests whether a text looks like this format; this is used if several formats have the same suffix."""
        ...

    @staticmethod
    def read(text: str, *, source: str, locked: Mapping[str, float], tip: str | None) -> Robot:
        """Reads the robot that a text describes.

        The joints of `locked` with one degree of freedom are still joints of the result; joints with more degrees of
        freedom are made fixed.
        """
        ...

    @staticmethod
    def outline(text: str, *, source: str) -> JointOutline:
        """Reads the list of all joints of a description and the tree that they form.

        The list includes joints with more than one degree of freedom and joints whose position depends on another
        joint (mimic joints).
        """
        ...


@dataclass(frozen=True, slots=True)
class DescriptionFormat:
    """Format of robot descriptions.

    Attributes:
        module: Module that reads this format.
        suffixes: Suffixes of files of this format, in lower case, with the dot.
    """

    module: str
    suffixes: tuple[str, ...]

    @property
    def reader(self) -> DescriptionReader:
        """Module that reads this format; it is imported on first use."""
        return cast("DescriptionReader", import_module(self.module))


READERS: Mapping[str, DescriptionFormat] = {
    "urdf": DescriptionFormat("armid.robot.readers.urdf", (".urdf", ".xml")),
    "mjcf": DescriptionFormat("armid.robot.readers.mjcf", (".mjcf", ".xml")),
    "xacro": DescriptionFormat("armid.robot.readers.xacro", (".xacro",)),
    "dh": DescriptionFormat("armid.robot.readers.dh", (".toml",)),
}
