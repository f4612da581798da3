"""Search for folders of ROS packages: given ones, above the description, ROS_PACKAGE_PATH, AMENT_PREFIX_PATH.

A description names meshes as package://NAME/… and xacro files as $(find NAME)/…, but not the folder of package NAME.
ROS need not be installed.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from contextvars import ContextVar, Token
from pathlib import Path
from types import MappingProxyType

from armid.errors import RobotError

REMEDY = "say where the package is with --package NAME=DIR, ROS_PACKAGE_PATH or AMENT_PREFIX_PATH"

_given: ContextVar[Mapping[str, str]] = ContextVar("_given", default=MappingProxyType({}))


def give_packages(packages: Mapping[str, str]) -> Token[Mapping[str, str]]:
    """Registers packages by their folders in this context; `forget` removes them.

    Raises:
        RobotError: A folder does not exist.
    """
    for name, folder in packages.items():
        if not Path(folder).is_dir():
            raise RobotError(f"The folder {folder} of the package {name} does not exist.", remedy="correct the path.")
    return _given.set({**_given.get(), **packages})


def forget(token: Token[Mapping[str, str]]) -> None:
    """Removes the packages that were registered."""
    _given.reset(token)


def given_packages() -> Mapping[str, str]:
    """Packages whose folders were registered."""
    return _given.get()


def package_folders(name: str, source: str) -> list[Path]:
    """Existing folders that may contain a package, the most likely first.

    Args:
        name: The package.
        source: Path of the description that names it.
    """
    above = Path(source).resolve().parent
    found = [Path(_given.get()[name])] if name in _given.get() else []
    found += [up if up.name == name else up / name for up in (above, *above.parents)]
    for entry in _entries("ROS_PACKAGE_PATH"):
        found += [entry] if entry.name == name else []
        found += [entry / name, *_below(entry, name)]
    found += [entry / "share" / name for entry in _entries("AMENT_PREFIX_PATH")]
    return [folder for folder in dict.fromkeys(found) if folder.is_dir()]


def file_of(name: str, inside: Path, source: str) -> str:
    """Path of a file in a package; empty where it is not found.

    Where no folder has the package's name, a folder above the description that contains the path is used, as for a
    folder of meshes that was copied alone.
    """
    above = Path(source).resolve().parent
    places = [folder / inside for folder in package_folders(name, source)]
    places += [up / inside for up in (above, *above.parents)]
    return next((str(place) for place in places if place.is_file()), "")


def _entries(variable: str) -> list[Path]:
    """Folders in an environment variable."""
    return [Path(entry) for entry in os.environ.get(variable, "").split(os.pathsep) if entry]


def _below(folder: Path, name: str) -> list[Path]:
    """Folders with a name and a package description, up to three levels below another folder."""
    found = [path for deep in ("*", "*/*", "*/*/*") for path in sorted(folder.glob(f"{deep}/{name}/package.xml"))]
    return [path.parent for path in found]
