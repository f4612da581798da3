"""Catalogue `EXPORTERS` of the formats of robot descriptions: a new format needs a module and one line here."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

from armid.lazy_catalogue import Catalogue

if TYPE_CHECKING:
    from armid.checked_array import Array
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


class Exporter(Protocol):
    """Interface that the module of a format has."""

    SUFFIX: str
    """Suffix of the file's name, with the dot."""

    PLACES: Sequence[str]
    """Names of the torque terms whose parameters the format can store."""

    @staticmethod
    def open_description(path: Path, data: bytes) -> OpenedDescription | None:
        """Reads a description so that it can be edited; `None` if its format is not that of this exporter.

        Args:
            path: Path of the description.
            data: Content of the description.
        """
        ...

    @staticmethod
    def bodies(source: DescriptionSource, raw: Robot, robot: Robot) -> list[Body]:
        """Bodies of a description that move.

        The main body of a link comes before the bodies attached to the main body.

        Args:
            source: The description.
            raw: Arm of the description, in which locked joints are still joints.
            robot: Arm whose links include the bodies on locked joints.
        """
        ...

    @staticmethod
    def write(content: Content) -> WrittenDescription:
        """Makes the file to be written: the edited description if there is one, otherwise a new description."""
        ...

    @staticmethod
    def missing_limits(robot: Robot) -> OutputError | None:
        """Error about limits that the format needs in a new file, but that are unknown.

        The result is `None` if no limit is missing.
        """
        ...

    @staticmethod
    def read(data: bytes, locked: Mapping[str, float]) -> Robot:
        """Reads the arm back from a written file.

        Angles are taken exactly as written, unlike in the usual reader, and locked joints are read as joints.
        """
        ...

    @staticmethod
    def witnesses(data: bytes, content: Content, q: Array, dq: Array, ddq: Array) -> list[Witness]:
        """Models that other programs read from a written file, with the rigid-body torque of each at N states."""
        ...


EXPORTERS: Catalogue[Exporter] = Catalogue(
    {
        "urdf": "armid.export.formats.urdf",
        "mjcf": "armid.export.formats.mjcf",
        "sdf": "armid.export.formats.sdf",
    }
)
"""Modules of the formats; the keys are the names that `armid export --to` accepts."""
