"""Reader of xacro, which the package xacrodoc expands to URDF.

The digest of the description is computed from the expanded text, because included files also change the robot.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Callable, Generator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from threading import Lock
from typing import Any

from armid.errors import MissingExtraError, RobotError
from armid.input_boundary import read_text, reason
from armid.robot.joint_selection import JointOutline
from armid.robot.packages import REMEDY, given_packages, package_folders, refuse_outside
from armid.robot.readers import urdf
from armid.robot.robot import Robot
from armid.robot.urdf.xacro_expression import evaluate
from armid.robot.xml import parse_xml, root_tag

MOST_CALLS = 5000
"""Largest number of calls of macros. Macros that call others twice would double the description again and again; the
limit of links is 5000, too."""

EXPANDING = Lock()
"""Lock of an expansion: xacro keeps the files that it reads in variables of its module, and its functions that run
expressions or open files are replaced meanwhile."""


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
        from xacro import substitution_args
    except ImportError as error:
        raise MissingExtraError("xacrodoc", f"Reading {source}", "xacro") from error
    parse_xml(text, source)
    with EXPANDING:
        xacrodoc.packages.reset()  # else folders of packages of an earlier description are used
        xacrodoc.packages.walk_up_from(source)
        counted, count = _counted_calls(xacro.handle_macro_call)
        read_only, parse = _contained(xacro, source, xacrodoc.packages)
        own = {"handle_macro_call": count, "abs_filename_spec": read_only, "parse": parse, "safe_eval": evaluate}
        with _replaced(xacro, own), _replaced(substitution_args, {"_eval": _evaluate_argument}):
            xacrodoc.packages.update_package_cache(dict(given_packages()))
            return _expanded(text, source, xacro, xacrodoc, counted)


@contextmanager
def _replaced(module: Any, functions: Mapping[str, Callable[..., Any]]) -> Generator[None]:
    """Context in which functions of a module are replaced, by their names."""
    plain = {name: getattr(module, name) for name in functions}
    try:
        for name, function in functions.items():
            setattr(module, name, function)
        yield
    finally:
        for name, function in plain.items():
            setattr(module, name, function)


def _expanded(text: str, source: str, xacro: Any, xacrodoc: Any, counted: list[None]) -> str:
    """URDF text of a xacro text, after a search for packages that it names."""
    asked: set[str] = set()
    while True:
        try:
            # xacro resolves relative includes against the first file of a global stack.
            xacro.init_stacks(str(Path(source).resolve()))
            counted.clear()
            document = xacrodoc.XacroDoc.from_string(text, resolve_packages=False)
            return document.dom.toxml()
        except Exception as error:
            refused = _refusal(error)
            if refused is not None:
                raise RobotError(
                    f"{source}: {refused.problem}", possible=refused.possible, remedy=refused.remedy
                ) from error
            lacking = LACKING.search(str(error))
            name = "" if lacking is None else lacking[1]
            places = package_folders(name, source) if name and name not in asked else []
            if not places:
                raise _unexpanded(source, error, name) from error
            asked.add(name)
            xacrodoc.packages.update_package_cache({name: str(places[0])})


def _counted_calls(plain: Callable[..., Any]) -> tuple[list[None], Callable[..., Any]]:
    """List that gets an entry for each call of a macro, and a function that calls macros, but not too many."""
    calls: list[None] = []

    def handle_macro_call(*arguments: Any) -> Any:
        calls.append(None)
        if len(calls) > MOST_CALLS:
            raise RobotError(
                f"More than {MOST_CALLS} macros are called.", remedy="expand the file with xacro, and give the URDF."
            )
        return plain(*arguments)

    return calls, handle_macro_call


def _contained(xacro: Any, source: str, packages: Any) -> tuple[Callable[..., Any], Callable[..., Any]]:
    """Functions for the path of a file and for its contents, which read only what the description may read.

    Args:
        xacro: The module, whose functions `abs_filename_spec` and `parse` they replace.
        source: Path of the description.
        packages: Module of xacrodoc with the folders of the packages that were found.
    """
    plain = xacro.abs_filename_spec, xacro.parse

    def abs_filename_spec(name: str) -> str:
        path = str(plain[0](name))
        refuse_outside(path, source, packages._finder.package_cache.values())
        return path

    def parse(given: Any, filename: str | None = None) -> Any:
        if given is None and filename is not None:
            path = Path(str(xacro.root_dir or ""), filename)
            if path.exists():
                given = read_text(path, f"a part of {source}", RobotError)
                parse_xml(given, str(path))
        return plain[1](given, filename)

    return abs_filename_spec, parse


def _evaluate_argument(text: str, context: dict[str, Any]) -> str:
    """Value of `$(eval …)`; a replacement of the function of xacro, which would run any expression."""
    from xacro import substitution_args

    given = context.setdefault("arg", {})
    arguments = {name: substitution_args.convert_value(value, "auto") for name, value in given.items()}
    names = {**vars(substitution_args)["_eval_dict"], "arg": arguments.__getitem__}
    return str(evaluate(text, names, arguments))


def _refusal(error: BaseException | None) -> RobotError | None:
    """Error of a refused expression among the causes of an error of xacro; `None` if there is none."""
    seen = 0
    while error is not None and seen < 100:
        if isinstance(error, RobotError):
            return error
        error, seen = getattr(error, "exc", None) or error.__cause__ or error.__context__, seen + 1
    return None


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
        f"{source} cannot be expanded by xacro: {reason(error)}",
        remedy="expand the file where its packages are installed, and give the URDF.",
    )
