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
    """Interface of the module of a format."""

    SUFFIX: str
    """Suffix of the file's name, with the dot."""

    PLACES: Sequence[str]
    """Names of the torque terms whose parameters the format can store."""

    @staticmethod
    def open_description(path: Path, data: bytes) -> OpenedDescription | None:
        """Text of a description for editing; `None` if this exporter cannot edit it, for instance for its format.

        Args:
            path: Path of the description.
            data: Content of the description.
        """
        ...

    @staticmethod
    def bodies(source: DescriptionSource, raw: Robot, robot: Robot) -> list[Body]:
        """Moving bodies of a description; the main body of a link comes before the bodies attached to it.

        Args:
            source: The description.
            raw: Arm of the description, in which locked joints are still joints.
            robot: Arm whose links include the bodies on locked joints.
        """
        ...

    @staticmethod
    def write(content: Content) -> WrittenDescription:
        """File with the content: the edited description if there is one, otherwise a new file."""
        ...

    @staticmethod
    def missing_limits(robot: Robot) -> OutputError | None:
        """Error about limits that a new file needs but the arm does not have; `None` if no limit is missing."""
        ...

    @staticmethod
    def read(data: bytes, locked: Mapping[str, float]) -> Robot:
        """Arm of a written file; angles are not corrected, and locked joints are still joints."""
        ...

    @staticmethod
    def witnesses(data: bytes, content: Content, q: Array, dq: Array, ddq: Array) -> list[Witness]:
        """Models that other programs read from a written file, with their rigid-body torque at states (N, n)."""
        ...


EXPORTERS: Catalogue[Exporter] = Catalogue(
    {
        "urdf": "armid.export.formats.urdf",
        "mjcf": "armid.export.formats.mjcf",
        "sdf": "armid.export.formats.sdf",
    }
)
"""Modules of the formats, by the names that `armid export --to` uses."""
