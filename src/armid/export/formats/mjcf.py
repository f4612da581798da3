"""Writer of MJCF: writes an `<inertial>` for each body, and damping, frictionloss and armature for each joint.

In a description only the attributes that change are replaced. The inertia tensor is written in the axes of the body,
so it replaces the orientation and the principal moments of the `<inertial>`. Included files are inserted in the place
of their include elements, so that the result is one file.
"""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from collections.abc import Mapping, Sequence
from pathlib import Path
from xml.sax.saxutils import quoteattr

import numpy as np
from scipy.spatial.transform import Rotation

from armid.checked_array import Array
from armid.errors import Finding, OutputError, RobotError
from armid.export.body_split import placed
from armid.export.other_programs import model_of_mjcf, mujoco_witness, pinocchio_witness
from armid.export.types import (
    Body,
    Content,
    DescriptionSource,
    OpenedDescription,
    Witness,
    WrittenDescription,
    com_form,
    text_of,
    unique_names,
)
from armid.export.xml_edit import Document, XmlNode, element_text
from armid.robot.mjcf.plain_document import Plain, flatten, named, plain_mjcf
from armid.robot.mjcf.tree import tree_of_mjcf
from armid.robot.mjcf.unmodelled import changing_settings
from armid.robot.readers import mjcf as reader
from armid.robot.robot import InertialParameters, Robot
from armid.robot.xml import parse_xml

SUFFIX: str = ".xml"

ATTRIBUTES = {"viscous": "damping", "coulomb": "frictionloss", "rotor-inertia": "armature"}
PLACES: Sequence[str] = tuple(ATTRIBUTES)
FULL = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))
TURNED = ("diaginertia", "quat", "axisangle", "xyaxes", "zaxis", "euler")
KEPT = ("compiler", "option", "default", "worldbody", "size")
"""Sections of an MJCF that are needed to compute the dynamics of its rigid bodies."""
SHAPES = ("mesh", "hfield", "sdf", "skin")


def open_description(path: Path, data: bytes) -> OpenedDescription | None:
    """Reads an MJCF so that it can be edited; the contents of included files are inserted.

    The result is `None` for other formats.
    """
    if not reader.recognises(data.decode()):
        return None
    text, files = whole(path, data)
    included = (
        Finding(
            "includes-inlined",
            "info",
            "",
            "the contents of the files that the description includes were inserted into the written file",
        ),
    )
    return OpenedDescription(text, files, included if text != data else ())


def whole(path: Path, data: bytes, folder: Path | None = None) -> tuple[bytes, tuple[str, ...]]:
    """Inserts the contents of included files into a description; all other bytes stay unchanged.

    Args:
        path: Path of the description.
        data: Text of the description.
        folder: Folder of the included files; `None` for the folder of the description.

    Returns:
        Text with the included contents, and paths of the description and of all included files.

    Raises:
        RobotError: An included file cannot be read.
    """
    folder = path.parent if folder is None else folder
    files = [str(path)]
    document = Document(data)
    for node in document.root.walk():
        if node.tag == "include":
            other = folder / node.values.get("file", "")
            try:
                text, included_files = whole(other, other.read_bytes(), folder)
            except OSError as error:
                raise RobotError(
                    f"{path} includes {other}, which cannot be read ({error}).",
                    remedy="put the included file at that path, or correct the path in the description.",
                ) from error
            files += included_files
            inside = Document(text)
            root = inside.root
            document.replace(node.start, node.end, inside.data[root.inner : root.closing].decode())
    return document.edited(), tuple(files)


def bodies(source: DescriptionSource, raw: Robot, robot: Robot) -> list[Body]:
    """Bodies of an MJCF that move; parents come before their children."""
    plain = _plain(source.data, source.locked, Path(source.path).resolve().parent)
    tree = tree_of_mjcf(plain)
    frames = {frame.name: frame for _, frame in tree.bodies()}
    # The plain form splits a body with several joints; only the last part is a body of the file.
    there = {name for node, name in names_of(Document(source.data).root).items() if node.tag == "body"}
    found: list[Body] = []
    for name, frame in frames.items():
        if frame.joint < 0 or name not in there:
            continue
        joint = raw.joint_index(tree.joints[frame.joint].name)
        link, placement, welded = placed(raw, source.locked, robot, joint, frame.placement)
        if link >= 0:
            vector = plain.inertias.get(name)
            nominal = None if vector is None else InertialParameters.from_vector(vector)
            found.append(Body(name, link, placement, nominal, welded, name in plain.uncomputed))
    return found


def write(content: Content) -> WrittenDescription:
    """Makes an MJCF: the description with inertias and joint values replaced, or a new one without shapes."""
    if content.source is None:
        return _fresh(content)
    document = Document(content.source.data)
    _refuse_computed(document.root)
    names = names_of(document.root)
    for node, name in names.items():
        if node.tag == "body" and name in (content.bodies or {}):
            _edit_inertial(document, node, (content.bodies or {})[name], name)
        elif node.tag == "joint":
            for term, value in content.joints.get(name, {}).items():
                document.set(node, ATTRIBUTES[term], text_of(value))
    return WrittenDescription(document.edited(), _relative_files(document))


def missing_limits(robot: Robot) -> OutputError | None:
    """Returns `None`, because MJCF needs no limits."""
    del robot


def read(data: bytes, locked: Mapping[str, float]) -> Robot:
    """Reads the arm from the text of an MJCF."""
    return reader.read(data.decode(), source="the written file", locked=locked, tip=None)


def witnesses(data: bytes, content: Content, q: Array, dq: Array, ddq: Array) -> list[Witness]:
    """Models that Pinocchio and MuJoCo read from a written MJCF; Pinocchio reads the plain form."""
    plain = _plain(data, content.locked)
    return [
        pinocchio_witness(lambda pin: model_of_mjcf(pin, plain.text), content, q, dq, ddq, reads=()),
        mujoco_witness(_without_meshes(data), content, q, dq, ddq, reads=PLACES),
    ]


def _plain(data: bytes, locked: Mapping[str, float], folder: Path | None = None) -> Plain:
    """Converts an MJCF to its plain form.

    Args:
        data: Text of the MJCF.
        locked: Positions of the locked joints [rad or m], by name.
        folder: Folder of the meshes.
    """
    root = flatten(parse_xml(data.decode(), "the description"), "the description")
    return plain_mjcf(root, "the description", locked, folder=folder)


def names_of(root: XmlNode) -> dict[XmlNode, str]:
    """Names of bodies and joints; the keys are their XML elements.

    Elements without a name get the name that the reader gives.
    """
    bodies = [node for node in root.walk() if node.tag == "body"]
    joints = [[child for child in body.children if child.tag in ("joint", "freejoint")] for body in bodies]
    given = [
        (body.values.get("name", ""), [joint.values.get("name", "") for joint in own])
        for body, own in zip(bodies, joints, strict=True)
    ]
    result: dict[XmlNode, str] = {}
    for body, own, (name, names) in zip(bodies, joints, named(given), strict=True):
        result[body] = name
        result.update(zip(own, names, strict=True))
    return result


def _refuse_computed(root: XmlNode) -> None:
    """Raises an error if a setting makes MuJoCo use other inertias than those in the file."""
    for compiler in root.every("compiler"):
        found = changing_settings(compiler.values, "the description")
        found += ["inertiafromgeom"] if compiler.values.get("inertiafromgeom") == "true" else []
        if found:
            raise OutputError(
                f"The compiler settings {', '.join(found)} of the description would change the inertias that are "
                "written.",
                remedy="remove these settings from the description, then identify and export again.",
            )


def _edit_inertial(document: Document, node: XmlNode, body: InertialParameters, name: str) -> None:
    mass, com, about = com_form(body, f"body {name!r}")
    wanted = {"pos": text_of(*com), "mass": text_of(mass), "fullinertia": text_of(*(about[i, j] for i, j in FULL))}
    if mass == 0.0:  # MuJoCo takes no tensor of zeros
        wanted["diaginertia"] = text_of(0.0, 0.0, 0.0)
        del wanted["fullinertia"]
    inertial = node.find("inertial")
    if inertial is None:
        document.first(node, [element_text("inertial", wanted)])
        return
    for key in (*TURNED, "fullinertia"):
        if key not in wanted:
            document.drop(inertial, key)
    for key, value in wanted.items():
        document.set(inertial, key, value)


def _relative_files(document: Document) -> tuple[Finding, ...]:
    names = [n.values["file"] for n in document.root.walk() if n.tag in (*SHAPES, "texture") and "file" in n.values]
    if not names:
        return ()
    what = f"{len(names)} files, such as {names[0]}, have paths relative to the folder of the description"
    return (Finding("relative-meshes", "info", "", what, "put the written file into the folder of the description"),)


def _without_meshes(data: bytes) -> str:
    """Removes from the text of an MJCF the elements that need other files or that act on the bodies from outside.

    A body with an `<inertial>` needs no geoms. In other bodies, all geoms but meshes stay, because MuJoCo computes
    the inertia of such a body from its geoms.
    """
    root = flatten(parse_xml(data.decode(), "the written file"), "the written file")  # gives every joint a name
    for section in [section for section in root if section.tag not in KEPT]:
        root.remove(section)
    for body in root.iter("body"):
        for geom in body.findall("geom"):
            if body.find("inertial") is not None or any(shape in geom.attrib for shape in SHAPES):
                body.remove(geom)
    for worldbody in root.iter("worldbody"):
        for drawn in [child for child in worldbody if child.tag != "body"]:
            worldbody.remove(drawn)
    for body in root.iter("body"):
        for drawn in [child for child in body if child.tag not in ("body", "joint", "freejoint", "inertial", "geom")]:
            body.remove(drawn)
    for geom in root.iter("geom"):
        geom.attrib.pop("material", None)
    return ET.tostring(root, encoding="unicode")


def _fresh(content: Content) -> WrittenDescription:
    """Makes a new MJCF, whose bodies have inertia but no shapes."""
    robot = content.robot
    names = unique_names([link.name for link in robot.links])

    def body(i: int, indent: str) -> list[str]:
        joint, inertial = robot.joints[i], robot.links[i].inertial or InertialParameters.zero()
        mass, com, about = com_form(inertial, f"body {names[i]!r}")
        full = text_of(*(about[k, m] for k, m in FULL))
        return [
            f"{indent}<body name={quoteattr(names[i])} {_pose(joint.placement)}>",
            f'{indent}  <inertial pos="{text_of(*com)}" mass="{text_of(mass)}" fullinertia="{full}"/>',
            f"{indent}  {_joint(content, i)}",
            *below(i, f"{indent}  "),
            f"{indent}</body>",
        ]

    def below(parent: int, indent: str) -> list[str]:
        tip = [f"{indent}<site name={quoteattr(robot.tip.name)} {_pose(robot.tip.placement)}/>"]
        children = [body(k, indent) for k, joint in enumerate(robot.joints) if joint.parent == parent]
        return [*(tip if robot.tip.parent == parent else []), *(line for child in children for line in child)]

    lines = [
        f"<mujoco model={quoteattr(robot.name)}>",
        '  <compiler angle="radian" autolimits="true"/>',
        f'  <option gravity="{text_of(*robot.gravity)}"/>',
        "  <worldbody>",
        *below(-1, "    "),
        "  </worldbody>",
        "</mujoco>",
    ]
    return WrittenDescription(("\n".join(lines) + "\n").encode())


def _pose(pose: Array) -> str:
    x, y, z, w = Rotation.from_matrix(pose[:3, :3]).as_quat()
    return f'pos="{text_of(*pose[:3, 3])}" quat="{text_of(w, x, y, z)}"'


def _joint(content: Content, i: int) -> str:
    joint = content.robot.joints[i]
    kind = "slide" if joint.is_prismatic else "hinge"
    parts = [f'<joint name={quoteattr(joint.name)} type="{kind}" axis="{text_of(*joint.axis)}"']
    if np.isfinite(joint.position_limits).all():
        parts.append(f'range="{text_of(*joint.position_limits)}"')
    if math.isfinite(joint.effort_limit):
        parts.append(f'actuatorfrcrange="{text_of(-joint.effort_limit, joint.effort_limit)}"')
    values = content.joints.get(joint.name, {})
    parts += [f'{ATTRIBUTES[term]}="{text_of(value)}"' for term, value in values.items()]
    return " ".join(parts) + "/>"
