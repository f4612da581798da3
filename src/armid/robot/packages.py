"""Search for the folders of ROS packages, and the folders from which a description may read files.

A description refers to meshes as package://NAME/… and to xacro files as $(find NAME)/…, but it does not contain the
folder of the package NAME. This folder is searched in the folders that the user gives, in those above the
description, and in those of ROS_PACKAGE_PATH and AMENT_PREFIX_PATH. ROS need not be installed.

A description from a stranger must not name any file of the computer. It may name files of its own package, or of its
folder and the one above, and of other packages; the limit `outside` of `armid.input_boundary` permits others. Links
are followed, since tools of ROS install links to the files of a package.
"""

from __future__ import annotations

import os
import re
import shlex
from collections.abc import Iterable, Mapping
from contextvars import ContextVar, Token
from pathlib import Path
from types import MappingProxyType

from armid.errors import RobotError
from armid.input_boundary import limit

REMEDY = "name the folder of the package with --package NAME=DIR, ROS_PACKAGE_PATH or AMENT_PREFIX_PATH"

SCHEMES = ("package://", "model://")
"""Beginnings of the names of files that lie in a package."""

LEVELS = 3
"""Number of folders in which files of unknown packages are searched: that of the description and those above it."""

MOST_FOLDERS = 50
"""Largest number of subfolders of a folder that is searched; a folder with more subfolders is no part of a
package."""

NAME = re.compile(r"\w[\w.-]*")
"""Pattern of the name of a package; a path is none."""

_given: ContextVar[Mapping[str, str]] = ContextVar("_given", default=MappingProxyType({}))


def give_packages(packages: Mapping[str, str]) -> Token[Mapping[str, str]]:
    """Registers the folders of packages by name in this context, until `forget` removes them.

    Raises:
        RobotError: A folder does not exist.
    """
    for name, folder in packages.items():
        if not Path(folder).is_dir():
            raise RobotError(
                f"The folder {folder} of the package {name} does not exist.", remedy="correct the path of the folder."
            )
    return _given.set({**_given.get(), **packages})


def forget(token: Token[Mapping[str, str]]) -> None:
    """Removes the packages that `give_packages` registered."""
    _given.reset(token)


def given_packages() -> Mapping[str, str]:
    """Folders that `give_packages` registered, by the name of the package."""
    return _given.get()


def may_read(path: Path | str, source: str, packages: Iterable[Path | str] = ()) -> bool:
    """Tests whether a description may read a file: one of its own folders, or of a package.

    Args:
        path: The file; links in it are not resolved.
        source: Path of the description.
        packages: Folders of further packages that were found for the description.
    """
    if limit("outside") > 0:
        return True
    homes = [_own_folder(Path(source).resolve().parent), _own_folder(Path(os.path.abspath(source)).parent)]
    homes += [*map(Path, packages), *map(Path, _given.get().values())]
    homes += [*_entries("ROS_PACKAGE_PATH"), *_entries("AMENT_PREFIX_PATH")]
    place = Path(os.path.abspath(path))
    return any(place.is_relative_to(os.path.abspath(home)) for home in homes)


def refuse_outside(path: Path | str, source: str, packages: Iterable[Path | str] = ()) -> None:
    """Raises an error if a description may not read a file; the arguments are those of `may_read`.

    Raises:
        RobotError: The file is outside of the folders of the description.
    """
    if not may_read(path, source, packages):
        raise RobotError(
            f"{source} names the file {path}, which is outside of its own folders and of known packages.",
            possible="files in the package of the description, or in its folder and the one above; packages given by "
            "--package NAME=DIR, ROS_PACKAGE_PATH or AMENT_PREFIX_PATH",
            remedy="if you trust the description, allow such files with armid --allow outside=1, or copy the file.",
        )


def _own_folder(folder: Path) -> Path:
    """Package of a description in a folder, or the folder above, unless it is the root or the user's home."""
    for up in (folder, *folder.parents):
        if any((up / name).is_file() for name in ("package.xml", "manifest.xml", "model.config")):
            return up
    above = folder.parent
    return folder if above == above.parent or above in Path.home().parents or above == Path.home() else above


def package_folders(name: str, source: str) -> list[Path]:
    """Existing folders that may contain a package, the most likely first.

    Args:
        name: Name of the package.
        source: Path of the description that refers to the package.
    """
    if not NAME.fullmatch(name):
        return []
    above = Path(source).resolve().parent
    found = [Path(_given.get()[name])] if name in _given.get() else []
    found += [up if up.name == name else up / name for up in _above(above)]
    for entry in _entries("ROS_PACKAGE_PATH"):
        found += [entry] if entry.name == name else []
        found += [entry / name, *_below(entry, name)]
    found += [entry / "share" / name for entry in _entries("AMENT_PREFIX_PATH")]
    return [folder for folder in dict.fromkeys(found) if folder.is_dir()]


def file_of(name: str, inside: Path, source: str) -> str:
    """Path of a file in a package; empty if it is not found.

    If no folder with the name of the package contains the file, the folders above the description are searched for
    the path inside the package. This helps if only a folder of meshes was copied.
    """
    if not NAME.fullmatch(name) or ".." in Path(os.path.normpath(inside)).parts:
        return ""
    above = Path(source).resolve().parent
    places = [folder / inside for folder in package_folders(name, source)]
    places += [Path(_given.get()[name]) / tail for tail in _tails(inside)] if name in _given.get() else []
    places += [up / inside for up in _above(above)[:LEVELS]]
    return next((str(place) for place in places if place.is_file()), "")


def option_for(references: Iterable[str], source: str) -> str:
    """Option `--package NAME=DIR` with which missing files are found; empty if none is near the description.

    The folder of the description, the two folders above it, and the folders in these are searched. A copy of meshes
    rarely has all folders of the package, so the search uses only the ends of the paths inside the package.

    Args:
        references: Names of missing files as in the description, such as `package://NAME/meshes/a.stl`.
        source: Path of the description.
    """
    above = Path(source).resolve().parent
    near = [*dict.fromkeys((above, *above.parents[: LEVELS - 1]))]
    near += [each for up in near for each in _folders_in(up)]
    found: dict[str, str] = {}
    for name, inside in filter(None, map(split_reference, references)):
        if name in found:
            continue
        places = ((folder, folder / tail) for tail in (inside, *_tails(inside)) for folder in near)
        folder = next((folder for folder, place in places if place.is_file()), None)
        if folder is not None:
            found[name] = shlex.quote(f"{name}={folder}")
        if not found:
            return ""  # the first search tells whether meshes are near
    return " ".join(f"--package {each}" for each in found.values())


def split_reference(reference: str) -> tuple[str, Path] | None:
    """Name of the package and path inside it, of a file such as `package://NAME/…`; `None` for another path."""
    for scheme in SCHEMES:
        if reference.startswith(scheme):
            package, _, inside = reference.removeprefix(scheme).partition("/")
            return package, Path(inside.lstrip("/"))
    return None


def _above(folder: Path) -> list[Path]:
    """A folder and those above it, without the root, below which every file of the computer lies."""
    return [up for up in (folder, *folder.parents) if up != up.parent]


def _tails(inside: Path) -> list[Path]:
    """Ends of a path (the path without its first folders), the longest first."""
    return [Path(*inside.parts[k:]) for k in range(1, len(inside.parts))]


def _folders_in(folder: Path) -> list[Path]:
    """Subfolders of a folder; none if there are too many for a search, or if the folder cannot be read."""
    try:
        found = sorted(path for path in folder.iterdir() if path.is_dir())
    except OSError:
        return []
    return found if len(found) <= MOST_FOLDERS else []


def _entries(variable: str) -> list[Path]:
    """Folders that are listed in an environment variable."""
    return [Path(entry) for entry in os.environ.get(variable, "").split(os.pathsep) if entry]


def _below(folder: Path, name: str) -> list[Path]:
    """Folders with a given name and a package.xml, up to three levels below another folder."""
    found = [path for deep in ("*", "*/*", "*/*/*") for path in sorted(folder.glob(f"{deep}/{name}/package.xml"))]
    return [path.parent for path in found]
