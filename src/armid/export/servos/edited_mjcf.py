"""MJCF of a servo result with the shapes of its description: bodies, joints, actuators and options are replaced."""

from __future__ import annotations

import os
from pathlib import Path

from armid.errors import Finding
from armid.export.body_split import share_out
from armid.export.formats import mjcf
from armid.export.servos.mjcf_actuators import (
    DRY,
    OPTIONS,
    actuator,
    delay_words,
    joint_values,
    written_links,
)
from armid.export.types import Content, DescriptionSource
from armid.export.xml_edit import Document, XmlNode, element_text
from armid.robot.mjcf.settings import ACTUATORS
from armid.robot.packages import may_read
from armid.robot.robot import InertialParameters
from armid.servo.parameters import ServoModel, ServoParameters

FOLDERS = ("meshdir", "texturedir", "assetdir")
"""Compiler settings with the folders of files."""


def reason_without_shapes(source: DescriptionSource | None) -> str:
    """Reason for which the shapes of a description cannot be kept; empty if they can."""
    if source is None or source.format != "mjcf":
        return "the description is not an MJCF"
    if source.locked:
        return f"joints of the description are locked ({', '.join(source.locked)})"
    files = _files(Document(source.data), Path(source.path).resolve().parent)
    outside = [path for path in files if not may_read(path, source.path)]
    if outside:
        return f"the description names a file outside of its folders: {outside[0]}"
    missing = [str(path) for path in files if not path.is_file()]
    more = f" and {len(missing) - 1} more" if len(missing) > 1 else ""
    return f"files of the description are missing: {missing[0]}{more}" if missing else ""


def edited_mjcf(
    source: DescriptionSource, model: ServoModel, parameters: ServoParameters, folder: Path
) -> tuple[bytes, tuple[Finding, ...]]:
    """The description with identified bodies, friction, rotor inertias and actuators, and the findings about it.

    Actuators of other joints are removed. Paths of meshes are relative to the folder of the written file.

    Args:
        source: The description, for which `reason_without_shapes` gives none.
        model: Arm and friction laws.
        parameters: Identified parameters.
        folder: Folder of the written file.

    Raises:
        OutputError: The inertias cannot be distributed among the bodies of the description.
    """
    links = [link.inertial or InertialParameters.zero() for link in written_links(model.robot, parameters)]
    bodies = mjcf.bodies(source, mjcf.read(source.data, source.locked), model.robot)
    changed, findings = share_out(links, bodies, lumped=False)
    content = Content(model.robot, joint_values(model, parameters), source, changed)
    document = Document(mjcf.write(content).data)
    names = {node: name for node, name in mjcf.names_of(document.root).items() if node.tag == "joint"}
    for node, name in names.items():
        if name in model.robot.joint_names:
            _set_all(document, node, DRY)
            if "name" not in node.values:
                document.set(node, "name", name)
    for option in document.root.every("option"):
        _set_all(document, option, OPTIONS)
    if document.root.find("option") is None:
        document.first(document.root, [element_text("option", OPTIONS)])
    _move_folders(document, Path(source.path).resolve().parent, folder)
    _replace_actuators(document, model, parameters)
    return document.edited(), findings


def _set_all(document: Document, node: XmlNode, values: dict[str, str]) -> None:
    for key, value in values.items():
        document.set(node, key, value)


def _replace_actuators(document: Document, model: ServoModel, parameters: ServoParameters) -> None:
    """Replaces the first actuator of each joint, and removes the others; the names of actuators are kept."""
    waiting = {joint.name: j for j, joint in enumerate(model.robot.joints)}
    sections = document.root.every("actuator")
    for node in (child for section in sections for child in section.children if child.tag in ACTUATORS):
        joint = node.values.get("joint", "")
        if joint in waiting:
            name = node.values.get("name", joint)
            document.replace(
                node.start, node.end, element_text(*actuator(name, joint, parameters, waiting.pop(joint)))
            )
        else:
            document.replace(node.start, node.end, "")
    new = [element_text(*actuator(joint, joint, parameters, j)) for joint, j in waiting.items()]
    lines = [f"<!-- {delay_words(parameters)} -->"] if parameters.delay.any() else []
    lines += ["<actuator>", *(f"  {line}" for line in new), "</actuator>"] if new else []
    if lines:
        document.replace(document.root.closing, document.root.closing, "\n".join([f"  {x}" for x in lines]) + "\n")


def _move_folders(document: Document, before: Path, after: Path) -> None:
    """Changes the folders of files from those relative to `before` to those relative to `after`."""
    compilers = document.root.every("compiler")
    stated = {key: each.values[key] for each in compilers for key in FOLDERS if key in each.values}
    wanted = stated if "assetdir" in stated else {"meshdir": "", "texturedir": "", **stated}
    values = {key: Path(os.path.relpath(before / value, after.resolve())).as_posix() for key, value in wanted.items()}
    if compilers:
        _set_all(document, compilers[-1], values)
    else:
        document.first(document.root, [element_text("compiler", values)])


def _files(document: Document, folder: Path) -> list[Path]:
    """Files of meshes, height fields, skins and textures."""
    stated = {
        key: each.values[key] for each in document.root.every("compiler") for key in FOLDERS if key in each.values
    }
    found: list[Path] = []
    for node in document.root.walk():
        if "file" in node.values and node.tag in (*mjcf.SHAPES, "texture"):
            key = "texturedir" if node.tag == "texture" else "meshdir"
            found.append(folder / stated.get(key, stated.get("assetdir", "")) / node.values["file"])
    return found
