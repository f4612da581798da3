"""Robot arm: links, joints with one degree of freedom, limits, gravity, and a tip frame."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from armid.checked_array import Array, array
from armid.errors import Finding, RobotError, did_you_mean
from armid.kernel.tree import Tree
from armid.maths import inertia as inertia_maths
from armid.maths.rotations import axis_rotation, homogeneous
from armid.notebook_display import Displayed, Summary, plural
from armid.robot.described_drive import DescribedDrive
from armid.robot.described_limits import refuse_impossible_limits
from armid.robot.shapes import Shape

EARTH_GRAVITY = (0.0, 0.0, -9.81)
"""Acceleration of gravity in the base frame of an upright arm [m/s²]; a hanging arm has (0, 0, 9.81)."""

CONSISTENCY_TOLERANCE = 1e-9
"""Largest size of a negative eigenvalue of a pseudo-inertia, divided by the largest eigenvalue, that counts as a
rounding error."""


@dataclass(frozen=True, eq=False, slots=True)
class InertialParameters:
    """Mass, first moment and inertia of a rigid body; the inertia is about the origin of its link frame.

    Attributes:
        mass: Mass [kg].
        first_moment: Mass times centre of mass, shape (3,) [kg·m].
        inertia: Ixx, Ixy, Iyy, Ixz, Iyz, Izz about the **link-frame origin**, shape (6,) [kg·m²].
    """

    mass: float
    first_moment: Array
    inertia: Array

    def __post_init__(self) -> None:
        object.__setattr__(self, "mass", float(self.mass))
        object.__setattr__(self, "first_moment", array(self.first_moment, (3,), "first_moment"))
        object.__setattr__(self, "inertia", array(self.inertia, (6,), "inertia"))
        if not math.isfinite(self.mass):
            raise RobotError(f"The mass must be finite; found {self.mass}.", remedy="give a finite mass [kg].")

    @classmethod
    def from_vector(cls, vector: ArrayLike) -> InertialParameters:
        """Inertial parameters from the vector (10,) m, mx, my, mz, Ixx, Ixy, Iyy, Ixz, Iyz, Izz [kg, kg·m, kg·m²]."""
        v = array(vector, (10,), "inertial parameters")
        return cls(float(v[0]), v[1:4], v[4:])

    @classmethod
    def from_com(cls, mass: float, com: ArrayLike, inertia_about_com: ArrayLike) -> InertialParameters:
        """Inertial parameters from mass [kg], centre of mass (3,) [m] and inertia (3, 3) about it [kg·m²]."""
        tensor = array(inertia_about_com, (3, 3), "inertia_about_com")
        return cls.from_vector(inertia_maths.com_inertia_to_vector(mass, array(com, (3,), "com"), tensor))

    @classmethod
    def zero(cls) -> InertialParameters:
        """Inertial parameters that are all zero."""
        return cls.from_vector(np.zeros(10))

    @property
    def vector(self) -> Array:
        """Vector m, mx, my, mz, Ixx, Ixy, Iyy, Ixz, Iyz, Izz, shape (10,)."""
        return np.concatenate([[self.mass], self.first_moment, self.inertia])

    @property
    def pseudo_inertia(self) -> Array:
        """Pseudo-inertia of the body, shape (4, 4)."""
        return inertia_maths.pseudo_inertia(self.vector)

    @property
    def com(self) -> Array:
        """Centre of mass, shape (3,) [m]; NaN if the mass is zero."""
        return self.first_moment / self.mass if self.mass else np.full(3, np.nan)

    def is_consistent(self, tolerance: float = CONSISTENCY_TOLERANCE) -> bool:
        """Tests whether a distribution of positive mass exists that has these parameters."""
        eigenvalues = np.linalg.eigvalsh(self.pseudo_inertia)
        return bool(eigenvalues[0] >= -tolerance * max(abs(eigenvalues[-1]), np.finfo(float).tiny))

    def seen_from(self, rotation: Array, translation: Array) -> InertialParameters:
        """Inertial parameters in a frame A that has this frame at the given rotation (3, 3) and origin (3,) [m]."""
        return self.from_vector(inertia_maths.transform(self.vector, rotation, translation))

    def __add__(self, other: InertialParameters) -> InertialParameters:
        """Sum of the parameters of two bodies that are rigidly connected, both given in the same frame."""
        return self.from_vector(self.vector + other.vector)


@dataclass(frozen=True, eq=False, slots=True)
class Joint:
    """Joint with one degree of freedom.

    Attributes:
        name: Name in the description.
        kind: `revolute`, `continuous` (revolute without position limits) or `prismatic`.
        parent: Index of the joint whose link carries this joint; -1 for the base.
        axis: Unit vector of the axis in the joint's frame, shape (3,).
        placement: Frame of the joint at q = 0 in the parent link's frame, shape (4, 4).
        position_limits: Lower and upper limit, shape (2,) [rad or m]; infinite if unknown.
        velocity_limit: Largest speed [rad/s or m/s]; infinite if unknown.
        effort_limit: Largest effort [N·m or N]; infinite if unknown.
        soft_limits: Lowest and highest position that the controller of the robot allows, shape (2,) [rad or m];
            infinite if unknown.
        drive: Rotor inertia and friction of the description.
    """

    name: str
    kind: Literal["revolute", "continuous", "prismatic"]
    parent: int
    axis: Array
    placement: Array
    position_limits: Array
    velocity_limit: float = math.inf
    effort_limit: float = math.inf
    soft_limits: Array = (-math.inf, math.inf)  # pyright: ignore[reportAssignmentType]
    drive: DescribedDrive = field(default_factory=DescribedDrive)

    def __post_init__(self) -> None:
        axis = array(self.axis, (3,), f"axis of joint {self.name!r}")
        length = float(np.linalg.norm(axis))
        if length == 0.0:
            raise RobotError(
                f"Joint {self.name!r} has an axis of zero length.", remedy="give the direction of the axis."
            )
        if self.kind not in ("revolute", "continuous", "prismatic"):
            raise RobotError(
                f"Joint {self.name!r} is of kind {self.kind!r}, which armid cannot model.",
                possible="revolute, continuous, prismatic",
                remedy="lock it at a position, or replace it by joints of these kinds.",
            )
        object.__setattr__(self, "axis", array(axis / length, (3,), "axis"))
        object.__setattr__(self, "placement", array(self.placement, (4, 4), f"placement of joint {self.name!r}"))
        for limits in ("position_limits", "soft_limits"):
            object.__setattr__(self, limits, array(getattr(self, limits), (2,), limits, finite=False))
        refuse_impossible_limits(self.name, self.position_limits, self.velocity_limit, self.effort_limit)

    @property
    def is_prismatic(self) -> bool:
        """Tests whether the joint is prismatic."""
        return self.kind == "prismatic"

    @property
    def unit(self) -> str:
        """Unit of the position, `rad` or `m`."""
        return "m" if self.is_prismatic else "rad"

    @property
    def effort_unit(self) -> str:
        """Unit of the effort, `N·m` or `N`."""
        return "N" if self.is_prismatic else "N·m"

    def motion(self, q: ArrayLike) -> tuple[Array, Array]:
        """Rotation (..., 3, 3) and origin (..., 3) [m] of the link frame in the parent's frame, at position q."""
        R0, p0 = self.placement[:3, :3], self.placement[:3, 3]
        q = np.asarray(q, dtype=np.float64)
        if self.is_prismatic:
            R = np.broadcast_to(R0, (*q.shape, 3, 3))
            return R, p0 + q[..., None] * (R0 @ self.axis)
        return R0 @ axis_rotation(self.axis, q), np.broadcast_to(p0, (*q.shape, 3))


@dataclass(frozen=True, eq=False, slots=True)
class Link:
    """Rigid body that is moved by the joint with the same index.

    Attributes:
        name: Name in the description; if several bodies were merged, the name of the first one.
        inertial: Inertial parameters in the link frame, from the description; `None` if it contains none.
    """

    name: str
    inertial: InertialParameters | None = None


@dataclass(frozen=True, eq=False, slots=True)
class Frame:
    """Frame fixed to a link.

    Attributes:
        name: Name of the frame.
        parent: Index of the link to which it is fixed; -1 for the base.
        placement: Pose in the link's frame, shape (4, 4).
    """

    name: str
    parent: int
    placement: Array

    def __post_init__(self) -> None:
        object.__setattr__(self, "placement", array(self.placement, (4, 4), f"placement of {self.name!r}"))


@dataclass(frozen=True, slots=True)
class Held:
    """Joint of the description that is locked.

    Attributes:
        name: Name of the joint.
        position: Position at which it is locked [rad or m].
        unit: Unit of the position, `rad` or `m`.
        place: Index among all joints of the description, including locked ones.
    """

    name: str
    position: float
    unit: str
    place: int


@dataclass(frozen=True, eq=False, slots=True, repr=False)
class Robot(Displayed):
    """Open chain or tree of joints on a fixed base.

    Attributes:
        name: Name of the arm.
        joints: Joints, parents before children.
        links: Links; joint i moves link i.
        tip: Frame of the tool flange.
        gravity: Acceleration of gravity in the base frame, shape (3,) [m/s²].
        source: Path of the description, or name of a built-in arm.
        sha256: Digest of the description and of all files that determine its joints and inertia; empty if there is
            no text. Files of meshes that are only drawn or checked for collisions are not included.
        findings: Findings of the reader.
        shapes: Collision geometry of the links that the description contains.
        visuals: Visual geometry of the links that the description contains.
        held: Joints with one degree of freedom that are locked.
    """

    name: str
    joints: tuple[Joint, ...]
    links: tuple[Link, ...]
    tip: Frame
    gravity: Array = EARTH_GRAVITY  # pyright: ignore[reportAssignmentType]
    source: str = ""
    sha256: str = ""
    findings: tuple[Finding, ...] = ()
    shapes: tuple[Shape, ...] = ()
    visuals: tuple[Shape, ...] = ()
    held: tuple[Held, ...] = ()

    def __post_init__(self) -> None:
        for name in ("joints", "shapes", "visuals", "links", "held"):
            object.__setattr__(self, name, tuple(getattr(self, name)))
        object.__setattr__(self, "gravity", array(self.gravity, (3,), "gravity"))
        if len(self.joints) != len(self.links):
            raise RobotError(
                f"Each joint must move one link; found {len(self.joints)} joints and {len(self.links)} links.",
                remedy="give as many links as joints.",
            )
        names = self.joint_names
        if len(set(names)) != len(names):
            raise RobotError(
                f"The names of the joints must differ; found {', '.join(names)}.", remedy="rename the joints."
            )
        self.tree  # noqa: B018  (raises where the joints do not form a tree)

    def __repr__(self) -> str:
        return f"Robot({self.name!r}: {', '.join(self.joint_names)}; tip {self.tip.name!r})"

    @property
    def n(self) -> int:
        """Number of joints."""
        return len(self.joints)

    @property
    def joint_names(self) -> tuple[str, ...]:
        """Names of the joints, in order."""
        return tuple(joint.name for joint in self.joints)

    @property
    def described_joints(self) -> tuple[str, ...]:
        """Names of all joints, including locked ones, in the order of the description."""
        names = list(self.joint_names)
        for held in sorted(self.held, key=lambda each: each.place):
            names.insert(held.place, held.name)
        return tuple(names)

    @property
    def tree(self) -> Tree:
        """Geometry of the arm as the `Tree` that the functions of `armid.kernel` take."""
        return Tree(
            parent=np.array([j.parent for j in self.joints]),
            prismatic=np.array([j.is_prismatic for j in self.joints]),
            axis=np.array([j.axis for j in self.joints]),
            rotation=np.array([j.placement[:3, :3] for j in self.joints]),
            translation=np.array([j.placement[:3, 3] for j in self.joints]),
            gravity=self.gravity,
        )

    @property
    def inertial_vector(self) -> Array | None:
        """Nominal inertial parameters, shape (n, 10); `None` if the description contains none."""
        if all(link.inertial is None or not link.inertial.vector.any() for link in self.links):
            return None
        zero = InertialParameters.zero()
        return np.array([(link.inertial or zero).vector for link in self.links])

    def summary(self) -> Summary:
        """Table of the joints with their limits."""
        limits = ((*each.position_limits, each.velocity_limit, each.effort_limit) for each in self.joints)
        rows = tuple(
            (each.name, each.kind, *(f"{x:.4g}" for x in bounds))
            for each, bounds in zip(self.joints, limits, strict=True)
        )
        gravity = ", ".join(f"{x:g}" for x in self.gravity)
        columns = ("joint", "kind", "lower", "upper", "velocity", "effort")
        return Summary(f"{self.name}: {plural(self.n, 'joint')}", columns, rows, f"gravity {gravity} m/s²; SI units")

    def joint_index(self, name: str) -> int:
        """Index of a joint by name.

        Raises:
            RobotError: The joint does not exist; the message lists the joints.
        """
        try:
            return self.joint_names.index(name)
        except ValueError:
            problem, remedy = f"{self.name} has no joint {name!r}.", did_you_mean(name, self.joint_names)
            if name in self.described_joints:
                problem = f"The joint {name!r} of {self.name} is locked and does not move."
                remedy = "name another joint, or do not lock it."
            raise RobotError(problem, possible=", ".join(self.joint_names), remedy=remedy) from None

    def with_gravity(self, gravity: ArrayLike) -> Robot:
        """Same arm with another acceleration of gravity (3,) [m/s²], for instance hanging from a ceiling."""
        return replace(self, gravity=array(gravity, (3,), "gravity"))

    def lock(self, values: Mapping[str, float] | Iterable[str]) -> Robot:
        """Arm with some joints locked; the link of each locked joint is merged into the link that carries it.

        Args:
            values: Names of the joints, or positions [rad or m] by name. A joint without a position is locked at 0.

        Raises:
            RobotError: A joint is unknown, or no movable joint remains.
        """
        wanted = dict(values) if isinstance(values, Mapping) else dict.fromkeys(values, 0.0)
        robot = self
        for name, value in wanted.items():
            robot = _weld(robot, robot.joint_index(name), float(value))
        return robot


def _weld(robot: Robot, index: int, value: float) -> Robot:
    """Robot without joint `index`, whose link is merged into its parent link at joint position `value`."""
    if robot.n == 1:
        raise RobotError(
            f"If {robot.joints[index].name!r} is locked, {robot.name} has no movable joint.",
            remedy="leave at least one joint movable.",
        )
    joint = robot.joints[index]
    rotation, translation = joint.motion(value)
    weld = homogeneous(rotation, translation)

    def moved(parent: int) -> int:
        parent = joint.parent if parent == index else parent
        return parent - (parent > index)

    joints: list[Joint] = []
    links: list[Link] = []
    for i, (other, link) in enumerate(zip(robot.joints, robot.links, strict=True)):
        if i == index:
            continue
        placement = weld @ other.placement if other.parent == index else other.placement
        joints.append(replace(other, parent=moved(other.parent), placement=placement))
        body = robot.links[index].inertial
        if i == joint.parent and body is not None:
            carried = body.seen_from(rotation, translation)
            carried = carried if link.inertial is None else link.inertial + carried
            links.append(replace(link, inertial=carried))
        else:
            links.append(link)
    tip = robot.tip
    if tip.parent == index:
        tip = replace(tip, placement=weld @ tip.placement)
    tip = replace(tip, parent=moved(tip.parent))
    shapes, visuals = (
        tuple(s.on(joint.parent, weld) if s.link == index else replace(s, link=moved(s.link)) for s in bodies)
        for bodies in (robot.shapes, robot.visuals)
    )
    held = Held(joint.name, value, joint.unit, robot.described_joints.index(joint.name))
    return replace(
        robot,
        joints=tuple(joints),
        links=tuple(links),
        tip=tip,
        shapes=shapes,
        visuals=visuals,
        held=(*robot.held, held),
    )
