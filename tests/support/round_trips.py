"""A description edited with other bodies and friction: what of it changed, and what other programs make of it."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from armid.checked_array import Array
from armid.export.input_digest_check import find_source
from armid.export.write import export_run
from armid.maths.inertia import pseudo_inertia
from armid.robot import Robot, load_robot
from exports import changed, run_of
from trees import random_inertial

__all__ = ["TOLERANCE", "RoundTrip", "formats_of", "round_trip", "without_edited"]

TOLERANCE = 1e-9
"""Of the largest torque: what is promised; three recursions' rounding is a thousand times less."""

COMMENT = re.compile(rb"<!--.*?-->", re.DOTALL)
QUOTED = rb"(?:\"[^\"]*\"|'[^']*')"
PROGRAMS = ("pinocchio", "mujoco")


@dataclass(frozen=True)
class RoundTrip:
    """Result for one description.

    Attributes:
        joints: Joints that move.
        kept: Whether every byte outside the edited spans is as it was.
        errors: Error of the torque over its largest value, of each program that took the file.
        refused: What a program said that takes neither the file nor the description.
    """

    joints: int
    kept: bool
    errors: dict[str, float]
    refused: dict[str, str]

    @property
    def holds(self) -> bool:
        """Tell whether the file is what it should be, as far as programs take it."""
        return self.kept and bool(self.errors) and all(error <= TOLERANCE for error in self.errors.values())


def formats_of(path: Path) -> str:
    """Format of a description: `urdf`, `mjcf` or nothing that is known."""
    try:
        tag = ET.parse(path).getroot().tag
    except ET.ParseError:
        return ""
    return {"robot": "urdf", "mujoco": "mjcf"}.get(tag, "")


def round_trip(path: Path, folder: Path, *, to: str, seed: int = 0) -> RoundTrip:
    """Put bodies of other mass and shape, friction and rotors into a description, and read the file back.

    Joints that follow others are held.

    Args:
        path: The description.
        folder: Where the run and the file go.
        to: Its format.
        seed: Of the bodies.

    Raises:
        ArmidError: It is no arm that armid reads, or the export was refused.
    """
    locked = _followers(path) if to == "urdf" else {}
    bodies = _bodies(load_robot(path, locked=locked), np.random.default_rng(seed))
    run = run_of(folder / "run", path.resolve(), seed=seed, inertial=bodies, locked=locked)
    before = find_source(run).data  # included files are put in place
    exported = export_run(run, to, folder / f"written{path.suffix}", description=path)
    read = {f"rigid-body torque in {name}": name for name in PROGRAMS}
    errors = {read[check.name]: check.value for check in exported.checks if check.name in read}
    refused = {f.channel: f.evidence for f in exported.findings if f.code == "not-checked"}
    kept = without_edited(exported.path.read_bytes(), to) == without_edited(before, to)
    return RoundTrip(run.robot.n, kept, errors, refused)


def _followers(path: Path) -> dict[str, float]:
    """Joints of a URDF that follow others, at zero."""
    joints = ET.parse(path).getroot().findall("joint")
    return {joint.get("name", ""): 0.0 for joint in joints if joint.find("mimic") is not None}


def _bodies(robot: Robot, rng: np.random.Generator) -> Array:
    """Bodies (n, 10) near those described, any others where no real body is described."""
    bodies = random_inertial(rng, robot.n)
    described = robot.inertial_vector
    if described is not None:
        real = np.linalg.eigvalsh(pseudo_inertia(described))[:, 0] > 0.0
        bodies[real] = described[real]
    return changed(bodies, rng)


def without_edited(data: bytes, form: str) -> bytes:
    """A description without what an export may touch; bytes of comments, order, quotes and spaces stay.

    In a URDF these are numbers in inertials and in the damping and friction of joints, and such elements where there
    were none. In an MJCF these are inertials and the damping, frictionloss and armature of joints.
    """
    comments: list[bytes] = []

    def put_away(found: re.Match[bytes]) -> bytes:
        comments.append(found[0])
        return b"\0%d\0" % (len(comments) - 1)

    edit = {"urdf": _urdf, "mjcf": _mjcf}[form]
    bare = edit(COMMENT.sub(put_away, data))
    return re.sub(rb"\0(\d+)\0", lambda found: comments[int(found[1])], bare)


def _urdf(text: bytes) -> bytes:
    text = re.sub(rb"<dynamics\b[^>]*>", _emptied(b"damping", b"friction"), text)
    text = re.sub(rb"\s*<dynamics\s*(?:/>|></dynamics>)", b"", text)
    text = re.sub(rb"<inertial\b[^>]*>.*?</inertial>", _urdf_inertial, text, flags=re.DOTALL)
    text = re.sub(rb"\s*<inertial\s*(?:/>|>\s*</inertial>)", b"", text)
    # What had no child has an end of its own now.
    return re.sub(rb"<(link|joint)\b([^>]*?)\s*(?:/>|>\s*</\1>)", rb"<\1\2/>", text)


def _urdf_inertial(found: re.Match[bytes]) -> bytes:
    inside = re.sub(rb"<origin\b[^>]*>", _emptied(b"xyz"), found[0])
    inside = re.sub(rb"<mass\b[^>]*>", _emptied(b"value"), inside)
    inside = re.sub(rb"<inertia\b[^>]*>", _emptied(b"ixx", b"ixy", b"ixz", b"iyy", b"iyz", b"izz"), inside)
    inside = inside.replace(b'<origin rpy="0 0 0"/>', b"<origin/>")
    return re.sub(rb"\s*<(?:origin|mass|inertia)\s*/>", b"", inside)


def _mjcf(text: bytes) -> bytes:
    text = re.sub(rb"<joint\b[^>]*>", _emptied(b"damping", b"frictionloss", b"armature"), text)
    text = re.sub(rb"\s*<inertial\b[^>]*?(?:/>|>\s*</inertial>)", b"", text)
    return re.sub(rb"<(joint|body)\b([^>]*?)\s*(?:/>|>\s*</\1>)", rb"<\1\2/>", text)


def _emptied(*names: bytes) -> Callable[[re.Match[bytes]], bytes]:
    """Takes attributes out of a tag."""
    attribute = re.compile(rb"\s+(?:" + b"|".join(names) + rb")\s*=\s*" + QUOTED)
    return lambda found: attribute.sub(b"", found[0])
