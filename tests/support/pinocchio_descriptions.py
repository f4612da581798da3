"""Descriptions read by Pinocchio and by armid: how far joints, inertias, torques and base parameters differ."""

from __future__ import annotations

import tempfile
import xml.etree.ElementTree as ET
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from armid.checked_array import Array
from armid.kernel import reference
from armid.model.base_parameters import find_base_parameters
from armid.model.dynamics_model import DynamicsModel
from armid.model.terms import RigidBody
from armid.robot.angle_rounding import rounded
from armid.robot.joint_selection import held_joints
from armid.robot.mjcf.plain_document import flatten, plain_mjcf
from armid.robot.readers import READERS
from armid.robot.robot import InertialParameters, Joint, Link, Robot
from trees import random_states

__all__ = ["TOLERANCE", "Agreement", "compare"]

TOLERANCE = 1e-12
"""Relative to the largest number of a kind; the rounding of some dozen products is a tenth of it or less."""

STATES = 5

MOST_JOINTS = 40
"""Base parameters of larger trees take minutes and are not compared."""

SLIDING = "P"


@dataclass(frozen=True)
class Agreement:
    """Differences of one description, relative to the largest number of a kind.

    Attributes:
        joints: Number of joints.
        placement: Largest difference of placements [m or 1] and axes.
        inertia: Largest difference of the ten parameters of a link, relative to the largest parameter of this link.
        torque: Largest difference of torques on random states.
        base: Largest difference of base parameters; `None` if they were not compared.
    """

    joints: int
    placement: float
    inertia: float
    torque: float
    base: float | None

    @property
    def holds(self) -> bool:
        """Tell whether the two readers agree."""
        return max(self.placement, self.inertia, self.torque, self.base or 0.0) <= TOLERANCE


def compare(path: Path, *, seed: int = 0) -> Agreement:
    """Read a description twice; what has several degrees of freedom, or follows a joint, is held at zero.

    Raises:
        ArmidError: armid refuses it.
        AssertionError: Names, order, parents or kinds of the joints differ.
    """
    text, source = path.read_text(encoding="utf-8"), str(path)
    form = "urdf" if READERS["urdf"].reader.recognises(text) else "mjcf"
    reader = READERS[form].reader
    outline = reader.outline(text, source=source)
    loose = {joint.name: 0.0 for joint in outline.joints if not joint.is_simple or joint.follows is not None}
    held = held_joints(outline, source, loose, (), None).at
    robot = reader.read(text, source=source, locked=held, tip=None)
    model = _urdf(text, held) if form == "urdf" else _mjcf(text, source, held)
    other = _robot(model, robot)
    assert other.joint_names == robot.joint_names
    assert [joint.parent for joint in other.joints] == [joint.parent for joint in robot.joints]
    assert [joint.is_prismatic for joint in other.joints] == [joint.is_prismatic for joint in robot.joints]
    vectors = [np.array([_vector(link) for link in each.links]) for each in (robot, other)]
    base = None
    if robot.n <= MOST_JOINTS and vectors[1].any():
        base = _difference(*(_base(each, v) for each, v in zip((robot, other), vectors, strict=True)))
    return Agreement(
        robot.n,
        max(
            max(float(np.abs(a.placement - b.placement).max()), float(np.abs(a.axis - b.axis).max()))
            for a, b in zip(robot.joints, other.joints, strict=True)
        ),
        max(_difference(a, b) for a, b in zip(*vectors, strict=True)),
        _torques(robot, vectors[0], model, np.random.default_rng(seed)),
        base,
    )


def _difference(mine: Array, theirs: Array) -> float:
    if mine.shape != theirs.shape:
        return np.inf  # other columns are kept, for instance because an angle is exactly as large as its threshold
    return float(np.abs(mine - theirs).max(initial=0.0) / (np.abs(theirs).max(initial=0.0) or 1.0))


def _vector(link: Link) -> Array:
    return np.zeros(10) if link.inertial is None else link.inertial.vector


def _urdf(text: str, held: dict[str, float]) -> Any:
    """Pinocchio's model of a URDF without what needs meshes, and without limits, which urdfdom wants complete."""
    import pinocchio as pin

    root = ET.fromstring(text)
    root.set("name", root.get("name") or "arm")
    for link in root.iter("link"):
        for drawn in [*link.findall("visual"), *link.findall("collision")]:
            link.remove(drawn)
    for joint in root.findall("joint"):
        for tag in ("mimic", "safety_controller", "limit"):
            for each in joint.findall(tag):
                joint.remove(each)
        if joint.get("type") not in ("revolute", "continuous", "prismatic") and joint.get("name") in held:
            joint.set("type", "fixed")
        ET.SubElement(joint, "limit", lower="0", upper="0", velocity="0", effort="0")
    return pin.buildModelFromXML(ET.tostring(root, encoding="unicode"))


def _mjcf(text: str, source: str, held: dict[str, float]) -> Any:
    """Pinocchio's model of the plain form of an MJCF."""
    import pinocchio as pin

    plain = plain_mjcf(flatten(ET.fromstring(text), source), source, held)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "plain.xml"
        path.write_text(plain.text, encoding="utf-8")
        model = pin.buildModelFromMJCF(str(path))
    model.gravity = pin.Motion(np.array(plain.gravity), np.zeros(3))
    return model


def _robot(model: Any, like: Robot) -> Robot:
    """The arm that Pinocchio reads; limits and tip do not come from it."""
    import pinocchio as pin

    joints: list[Joint] = []
    links: list[Link] = []
    for i in range(1, model.njoints):
        data = model.joints[i].createData()
        model.joints[i].calc(data, pin.neutral(model))
        subspace = np.asarray(data.S).reshape(6)  # linear part first
        sliding = model.joints[i].shortname().removeprefix("JointModel").startswith(SLIDING)
        joints.append(
            Joint(
                model.names[i],
                "prismatic" if sliding else "continuous",
                int(model.parents[i]) - 1,
                subspace[:3] if sliding else subspace[3:],
                np.array(model.jointPlacements[i].homogeneous),
                (-np.inf, np.inf),
            )
        )
        vector = np.asarray(model.inertias[i].toDynamicParameters())
        links.append(Link(model.names[i], InertialParameters.from_vector(vector)))
    return replace(like, joints=tuple(joints), links=tuple(links), shapes=(), visuals=())


def _base(robot: Robot, vectors: Array) -> Array:
    """Base parameters of the rigid bodies, after the correction of rounded angles that every description gets."""
    robot = rounded(robot)[0]
    return find_base_parameters(DynamicsModel(robot, (RigidBody(),))).regrouping @ vectors.ravel()


def _torques(robot: Robot, vectors: Array, model: Any, rng: np.random.Generator) -> float:
    """Difference of armid's torque of its reading from Pinocchio's torque of its own."""
    import pinocchio as pin

    q, dq, ddq = random_states(rng, STATES, robot.n)
    mine = reference.inverse_dynamics(robot.tree, vectors, q, dq, ddq)
    data, theirs = model.createData(), np.empty_like(mine)
    start = pin.neutral(model)
    for k in range(STATES):
        position = start.copy()
        for i in range(robot.n):
            joint = model.joints[i + 1]
            value = [q[k, i]] if joint.nq == 1 else [np.cos(q[k, i]), np.sin(q[k, i])]
            position[joint.idx_q : joint.idx_q + joint.nq] = value
        theirs[k] = pin.rnea(model, data, position, dq[k], ddq[k])
    return _difference(mine, theirs)
