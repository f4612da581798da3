"""Catalogue of the formats that a run's model is written in: one module a format, one line here."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Protocol

from armid.export.formats import mjcf, sdf, urdf
from armid.export.types import Body, Content, DescriptionSource, Witness, WrittenDescription
from armid.robot.robot import Robot
from armid.values import Array

__all__ = ["EXPORTERS", "Exporter"]


class Exporter(Protocol):
    """Offer of the module of a format."""

    SUFFIX: str
    """Ending of the file's name, with the dot."""

    PLACES: Sequence[str]
    """Terms for whose parameter the format has a place."""

    EDITS: bool
    """Whether a description of this format is edited in place."""

    @staticmethod
    def bodies(source: DescriptionSource, raw: Robot, robot: Robot) -> list[Body]:
        """Bodies of a description that move, a link's own body before those that it carries.

        Args:
            source: The description.
            raw: The arm as the description says it, its locked joints still joints.
            robot: The arm with these joints held still.
        """
        ...

    @staticmethod
    def write(content: Content) -> WrittenDescription:
        """The file: the description edited where there is one, else a file of its own."""
        ...

    @staticmethod
    def read(data: bytes, locked: Mapping[str, float]) -> Robot:
        """The arm that a written file says, its angles as they stand there, its locked joints still joints."""
        ...

    @staticmethod
    def witnesses(data: bytes, content: Content, q: Array, dq: Array, ddq: Array) -> list[Witness]:
        """Return what other programs make of a written file: torque of its rigid bodies along states (N, n)."""
        ...


EXPORTERS: Mapping[str, Exporter] = {
    "urdf": urdf,
    "mjcf": mjcf,
    "sdf": sdf,
}
"""Formats by the name that `armid export --to` knows them by."""
