"""Xacro file with a macro of the arm, which other xacro files include, such as those for MoveIt and ros2_control.

The macro has the name of the arm and the parameter `prefix`, which stands before the names of links and joints.
"""

from __future__ import annotations

import re
from collections.abc import Mapping

from armid.export.xml_edit import Document
from armid.robot.readers.xacro import expand

NEEDS_DESCRIPTION: bool = False

NAMESPACE = "http://www.ros.org/wiki/xacro"
NAMED = {
    "link": "name",
    "joint": "name",
    "parent": "link",
    "child": "link",
    "gazebo": "reference",
    "mimic": "joint",
    "material": "name",
    "transmission": "name",
    "actuator": "name",
    "ros2_control": "name",
    "sensor": "name",
    "gpio": "name",
}
"""Attributes with names that must differ where a file uses the macro twice, by tag."""


def write(urdf: bytes, about: str) -> dict[str, str]:
    """Makes a xacro file from a URDF; the name of the file is that of the arm."""
    document = Document(urdf)
    name = macro_name(document.root.values.get("name", ""))
    for node in document.root.walk():
        key = NAMED.get(node.tag)
        if node is not document.root and key is not None and node.values.get(key):
            document.set(node, key, "${prefix}" + node.values[key])
    root = document.root
    newline = document.newline
    if "xmlns:xacro" not in root.values:
        document.set(root, "xmlns:xacro", NAMESPACE)
    comment = about.replace("--", "- -")
    head = f'{newline}<!-- {comment} -->{newline}<xacro:macro name="{name}" params="prefix:=\'\'">'
    document.replace(root.inner, root.inner, head)
    document.replace(root.closing, root.closing, f"</xacro:macro>{newline}")
    return {f"{name}.urdf.xacro": document.edited().decode()}


def expanded(files: Mapping[str, str], urdf: bytes) -> bytes:
    """Makes the URDF of a file that includes the xacro file and uses the macro once."""
    ((name, text),) = files.items()
    macro = name.removesuffix(".urdf.xacro")
    opened, closing, rest = text.rpartition("</robot>")
    return expand(f'{opened}<xacro:{macro} prefix=""/>{closing}{rest}', name).encode()


def macro_name(robot: str) -> str:
    """Name of the macro of an arm: its name with underscores for characters that a macro name cannot have."""
    name = re.sub(r"\W+", "_", robot).strip("_")
    return name if name[:1].isalpha() else f"arm_{name}"
