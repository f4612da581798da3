"""Catalogue of export formats: one module and one line for each."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Protocol

from armid.export.formats import mjcf, sdf, urdf
from armid.export.types import Body, Content, DescriptionSource, Witness, WrittenDescription
from armid.robot.robot import Robot
from armid.values import Array

__all__ = ["EXPORTERS", "Exporter"]


class Exporter(Protocol):
    """Interface of the module of a format."""

    SUFFIX: str
    """Suffix of the file's name, with the dot."""

    PLACES: Sequence[str]
    """Terms whose parameters the format can store."""

    EDITS: bool
    """True if a description of this format is edited in place."""

    @staticmethod
    def bodies(source: DescriptionSource, raw: Robot, robot: Robot) -> list[Body]:
        """Moving bodies of a description, the main body of a link before the bodies attached to it.

        Args:
            source: The description.
            raw: The arm as the description says it, its locked joints still joints.
            robot: The arm with these joints held still.
        """
        ...

    @staticmethod
    def write(content: Content) -> WrittenDescription:
        """File with the content: the edited description if there is one, else a new file."""
        ...

    @staticmethod
    def read(data: bytes, locked: Mapping[str, float]) -> Robot:
        """Arm of a written file, with its angles unrounded and its locked joints as joints."""
        ...

    @staticmethod
    def witnesses(data: bytes, content: Content, q: Array, dq: Array, ddq: Array) -> list[Witness]:
        """Models that other programs read from a written file, with rigid-body torque at states (N, n)."""
        ...


EXPORTERS: Mapping[str, Exporter] = {
    "urdf": urdf,
    "mjcf": mjcf,
    "sdf": sdf,
}
"""Formats by their name in `armid export --to`."""
