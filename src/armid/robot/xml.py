"""Parser of XML for robot descriptions; it does not accept entities, and errors state the line."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from collections.abc import Iterable
from typing import NoReturn
from xml.parsers import expat

from armid.errors import RobotError
from armid.input_boundary import limit, within

XACRO = ("${", "$(")
"""Beginnings of expressions of xacro, which a URDF does not have."""


def parse_xml(text: str, source: str) -> ET.Element:
    """Root element of an XML text.

    Elements may be nested only as deeply as the limit `nesting` of `armid.input_boundary` allows.

    A document with a document type (DOCTYPE) is not accepted, because a document type could include other files or
    expand without bound. Robot descriptions do not need one.

    Args:
        text: The document.
        source: Path of the document, for messages.

    Raises:
        RobotError: The text is not well-formed, has a document type, or is nested too deeply.
    """
    depth = 0

    def refuse(*_: object) -> NoReturn:
        raise RobotError(
            f"{source}:{parser.CurrentLineNumber}: armid does not accept declarations of a document type or of "
            "entities.",
            remedy="remove the declaration <!DOCTYPE …>, and replace entities by their text.",
        )

    def enter(*_: object) -> None:
        nonlocal depth
        depth += 1
        if depth > deepest:
            within("nesting", depth, f"{source}:{parser.CurrentLineNumber}", RobotError)

    def leave(*_: object) -> None:
        nonlocal depth
        depth -= 1

    deepest = limit("nesting")
    parser = expat.ParserCreate("utf-8")
    parser.StartDoctypeDeclHandler = refuse
    parser.StartElementHandler = enter
    parser.EndElementHandler = leave
    try:
        parser.Parse(text.encode(), True)
        return ET.fromstring(text)
    except (expat.ExpatError, ET.ParseError) as error:
        line = parser.ErrorLineNumber
        reason = expat.ErrorString(parser.ErrorCode) or str(error)
        raise RobotError(
            f"{source}:{line}: the XML is not well-formed ({reason}).", remedy="correct the file or export it again."
        ) from error


def without_namespace(root: ET.Element) -> ET.Element:
    """Root element whose default XML namespace is removed from the tags below it; it changes the given element.

    Some programs, such as Drake, write one: <robot xmlns="…">. Tags of other namespaces stay as they are.
    """
    space, _, tag = root.tag.rpartition("}")
    if space and tag:
        for element in root.iter():
            element.tag = element.tag.removeprefix(f"{space}}}")
    return root


def root_tag(text: str) -> str:
    """Tag of the root element; empty if there is none."""
    tags: list[str] = []

    def start(tag: str, _: dict[str, str]) -> None:
        tags.append(tag)

    parser = expat.ParserCreate("utf-8")
    parser.StartElementHandler = start
    try:
        parser.Parse(text.encode(), True)
    except expat.ExpatError:
        pass
    return tags[0] if tags else ""


def numbers(element: ET.Element, attribute: str, count: int, source: str, where: str) -> list[float] | None:
    """Numbers in an attribute; `None` if the attribute is missing.

    Raises:
        RobotError: The attribute contains another number of values, or values that are not finite numbers.
    """
    text = element.get(attribute)
    if text is None:
        return None
    try:
        values = [float(word) for word in text.split()]
    except ValueError:
        values = []
    if len(values) != count or not all(math.isfinite(v) for v in values):
        wanted = "a finite number" if count == 1 else f"{count} finite numbers"
        raise RobotError(
            f"{source}: {attribute} of {where} must be {wanted}; found {text!r}.",
            remedy="this is an expression of xacro: give the file the suffix .xacro, or expand it with xacro."
            if any(sign in text for sign in XACRO)
            else "correct the attribute in the description.",
        )
    return values


def check_locked(locked: Iterable[str], known: Iterable[str], source: str) -> None:
    """Raises an error if joints to be locked do not exist in the description.

    Raises:
        RobotError: A joint does not exist; the message lists the existing joints.
    """
    names = list(known)
    missing = [name for name in locked if name not in names]
    if missing:
        raise RobotError(
            f"{source} has no joint {', '.join(map(repr, missing))} to lock.",
            possible=", ".join(names),
            remedy="lock joints by their names in the description.",
        )


def identity_only(name: str, kind: str, value: float) -> None:
    """Raises an error if a joint with several degrees of freedom is to be locked at a value other than zero.

    Raises:
        RobotError: `value` is not 0.
    """
    if value != 0.0:
        raise RobotError(
            f"Joint {name!r} is of kind {kind}, so it can be locked only at its zero pose; found the value {value}.",
            remedy=f"lock {name!r} without a value, or replace it by a fixed joint with the desired pose.",
        )


def floating(source: str, name: str, kind: str, possible: str) -> RobotError:
    """Error for a joint with several degrees of freedom that is not locked, for instance a floating base."""
    return RobotError(
        f"{source}: joint {name!r} is of kind {kind!r}, but armid needs joints with one degree of freedom.",
        possible=possible,
        remedy=f"lock {name!r} (--lock {name}), or select one arm with --tip LINK.",
    )
