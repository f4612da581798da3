"""Catalogue `EXPORTERS` of the formats of robot descriptions: a new format is a new file and one line here."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

from armid.catalogue import Catalogue

if TYPE_CHECKING:
    from armid.errors import OutputError
    from armid.export.types import (
        Body,
        Content,
        DescriptionSource,
        OpenedDescription,
        Witness,
        WrittenDescription,
    )
    from armid.robot.robot import Robot
    from armid.values import Array


class Exporter(Protocol):
    """Interface of the module of a format."""

    SUFFIX: str
    """Suffix of the file's name, with the dot."""

    PLACES: Sequence[str]
    """Terms whose parameters the format can store."""

    @staticmethod
    def open_description(path: Path, data: bytes) -> OpenedDescription | None:
        """Text of a description to be edited; `None` for one of another format, or if the exporter edits none.

        Args:
            path: Its path.
            data: Its bytes.
        """
        ...

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
    def missing_limits(robot: Robot) -> OutputError | None:
        """Error for limits that a new file needs and the arm lacks; `None` where it lacks none."""
        ...

    @staticmethod
    def read(data: bytes, locked: Mapping[str, float]) -> Robot:
        """Arm of a written file, with its angles unrounded and its locked joints as joints."""
        ...

    @staticmethod
    def witnesses(data: bytes, content: Content, q: Array, dq: Array, ddq: Array) -> list[Witness]:
        """Models that other programs read from a written file, with rigid-body torque at states (N, n)."""
        ...


EXPORTERS: Catalogue[Exporter] = Catalogue(
    {
        "urdf": "armid.export.formats.urdf",
        "mjcf": "armid.export.formats.mjcf",
        "sdf": "armid.export.formats.sdf",
    }
)
"""Formats by their name in `armid export --to`."""
