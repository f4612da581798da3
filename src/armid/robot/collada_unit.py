"""Unit of length of a Collada file.

Assimp, the library with which Coal reads meshes, puts the unit and the rotation for the upward axis into the
transformation of the root node of a scene. Coal ignores this transformation. RViz and Gazebo ignore only the rotation
and apply the unit; armid does the same.
"""

from __future__ import annotations

import math
from pathlib import Path
from xml.parsers import expat

from armid.errors import RobotError

HEAD = 1 << 18
"""Number of bytes that are read; the element `asset` with the unit is the first one of a file."""


def collada_unit(path: str) -> float:
    """Unit of length of a Collada file [m]; 1 if the file gives none, is not a Collada file or cannot be read.

    Args:
        path: Path of a mesh.

    Raises:
        RobotError: The unit is not a positive number.
    """
    if Path(path).suffix.lower() != ".dae":
        return 1.0
    try:
        with Path(path).open("rb") as file:
            text = _unit_text(file.read(HEAD))
    except OSError:  # the error of the reader of meshes says more
        return 1.0
    try:
        unit = float(text)
    except ValueError:
        unit = math.nan
    if not (unit > 0.0 and math.isfinite(unit)):
        raise RobotError(
            f'{path}: the unit of length must be a positive number of metres; found <unit meter="{text}">.',
            remedy='correct it in the file, for instance <unit meter="0.001" name="millimeter"/>.',
        )
    return unit


def _unit_text(head: bytes) -> str:
    """Value of the attribute `meter` of the unit in the first element `asset`; `1` if there is none."""
    open_elements: list[str] = []
    found: list[str] = []

    def start(tag: str, attributes: dict[str, str]) -> None:
        open_elements.append(tag.rpartition(":")[2])
        if open_elements[1:] == ["asset", "unit"]:
            found.append(attributes.get("meter", "1"))

    def end(_: str) -> None:
        open_elements.pop()

    parser = expat.ParserCreate()
    parser.StartElementHandler = start
    parser.EndElementHandler = end
    try:
        parser.Parse(head, False)
    except expat.ExpatError:  # the error of the reader of meshes says more
        pass
    return found[0] if found else "1"
