"""Reader of xacro, which the package xacrodoc expands to URDF.

The digest of the description is computed from the expanded text, because included files also change the robot.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from xml.parsers.expat import ExpatError

from armid.errors import MissingExtraError, RobotError
from armid.robot.joint_selection import JointOutline
from armid.robot.packages import REMEDY, given_packages, package_folders
from armid.robot.readers import urdf
from armid.robot.robot import Robot
from armid.robot.xml import parse_xml, root_tag


def recognises(text: str) -> bool:
    """Tests whether a text looks like xacro."""
    return root_tag(text) == "robot" and "ros.org/wiki/xacro" in text


def read(text: str, *, source: str, locked: Mapping[str, float], tip: str | None) -> Robot:
    """Reads the robot of a xacro text; xacro arguments have their default values.

    Args:
        text: The xacro text.
        source: Path of the text; packages that are named by $(find …) are searched in the folders above it.
        locked: Joints to be locked, with positions [rad or m].
        tip: Name of the link that is the flange; if `None`, it is searched.

    Raises:
        MissingExtraError: xacrodoc is not installed.
        RobotError: The text cannot be expanded, or the result is not a robot.
    """
    expanded = expand(text, source)
    robot = urdf.read(expanded, source=source, locked=locked, tip=tip)
    return replace(robot, sha256=hashlib.sha256(expanded.encode()).hexdigest())


def outline(text: str, *, source: str) -> JointOutline:
    """Joints of the URDF to which a xacro text is expanded, and the joint that moves each link.

    Raises:
        MissingExtraError: xacrodoc is not installed.
        RobotError: The text cannot be expanded, or the result is not a robot.
    """
    return urdf.outline(expand(text, source), source=source)


def expand(text: str, source: str) -> str:
    """Expands a xacro text to URDF text.

    Raises:
        MissingExtraError: xacrodoc is not installed.
        RobotError: The text cannot be expanded.
    """
    try:
        import xacro
        import xacrodoc
        from xacro.substitution_args import SubstitutionException
    except ImportError as error:
        raise MissingExtraError("xacrodoc", f"Reading {source}", "xacro") from error
    parse_xml(text, source)
    xacrodoc.packages.reset()  # else folders of packages of an earlier description are used
    xacrodoc.packages.walk_up_from(source)
    faults = (
        xacro.XacroException,
        SubstitutionException,
        xacrodoc.packages.PackageNotFoundError,
        OSError,
        ValueError,
        ExpatError,
    )
    xacrodoc.packages.update_package_cache(dict(given_packages()))
    asked: set[str] = set()
    while True:
        try:
            # xacro resolves relative includes against the first file of a global stack.
            xacro.init_stacks(str(Path(source).resolve()))
            document = xacrodoc.XacroDoc.from_string(text, resolve_packages=False)
            return document.dom.toxml()
        except faults as error:
            lacking = LACKING.search(str(error))
            name = "" if lacking is None else lacking[1]
            places = package_folders(name, source) if name and name not in asked else []
            if not places:
                raise _unexpanded(source, error, name) from error
            asked.add(name)
            xacrodoc.packages.update_package_cache({name: str(places[0])})


LACKING = re.compile(r"Package not found: (\S+)")
"""Pattern of the message of xacrodoc about a package that it does not find."""


def _unexpanded(source: str, error: Exception, package: str) -> RobotError:
    """Error about a xacro text that cannot be expanded."""
    if package:
        return RobotError(
            f"{source} cannot be expanded by xacro: the package {package} is not found.",
            remedy=f"{REMEDY.replace('NAME', package)}; or expand the file where the package is installed, and give "
            "the URDF.",
        )
    return RobotError(
        f"{source} cannot be expanded by xacro: {' '.join(str(error).split())}",
        remedy="expand the file where its packages are installed, and give the URDF.",
    )
