"""Catalogue `ROS_FILES` of files for ROS description packages: a new kind needs a module and one line here."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Protocol

from armid.lazy_catalogue import Catalogue


class RosFiles(Protocol):
    """Interface that the module of a kind of files has."""

    NEEDS_DESCRIPTION: bool
    """True if the run must have a URDF or xacro of the package as its description."""

    @staticmethod
    def write(urdf: bytes, about: str) -> Mapping[str, str]:
        """Makes the files from a URDF.

        Args:
            urdf: Text of the URDF with the identified values.
            about: Comment for the head of the files, one line.

        Returns:
            Text of each file, by the name of the file.

        Raises:
            OutputError: The URDF does not have the links and joints of the package.
        """
        ...

    @staticmethod
    def expanded(files: Mapping[str, str], urdf: bytes) -> bytes:
        """Makes the URDF to which the macros of the package expand the files, with all other contents of `urdf`."""
        ...


ROS_FILES: Catalogue[RosFiles] = Catalogue(
    {
        "xacro": "armid.export.ros.files.xacro",
        "ur-description": "armid.export.ros.files.ur_description",
        "franka-description": "armid.export.ros.files.franka_description",
    }
)
"""Modules of the kinds of files; the keys are names that `armid export --to` accepts."""
