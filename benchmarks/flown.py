"""A plan flown on paper by another program: does it keep what it promised?

Shares nothing with armid but the files: `plan.json` for (3.55b), the description for limits, masses and bodies. URDF
goes through Pinocchio; a DH table in TOML is built joint by joint into a Pinocchio model here. Bodies are measured as
they are, meshes by their triangles, by Coal through Pinocchio, at every sample at which the convex hulls of the
meshes, made by Coal, are not further apart already.
"""

from __future__ import annotations

import json
import math
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import coal
import numpy as np
import pinocchio as pin

ROUNDING = 1e-9
"""Share of a limit, and rad/s and rad/s² of rest, that rounding may make."""

NEIGHBOURS, CONSTRUCTION = 2, 0.5
"""Links so many joints apart touch by construction if they do in more than this share of random poses."""

ALWAYS, LOOKED = 0.99, 1000
"""Links any number of joints apart do if they touch in this share of so many random poses. The floor is touched by
construction by the first link only."""

THICK = 1.0
"""Of the slab that stands for a floor [m]."""


@dataclass
class Arm:
    """Arm as the checker knows it: model, bodies with the joints that carry them, limits by joint."""

    model: pin.Model
    geometry: pin.GeometryModel
    lower: np.ndarray
    upper: np.ndarray
    velocity: np.ndarray
    effort: np.ndarray
    massive: bool


@dataclass
class Flight:
    """Observations: largest share of each limit, pairs that came too close, pairs that were not looked at."""

    shares: dict[str, float] = field(default_factory=dict)
    close: dict[str, int] = field(default_factory=dict)
    skipped: list[str] = field(default_factory=list)
    pairs: int = 0
    samples: int = 0

    @property
    def violations(self) -> int:
        """Limits broken, and samples in which a pair is too close."""
        return sum(share > 1.0 + ROUNDING for share in self.shares.values()) + sum(self.close.values())


def load_urdf(path: Path, locked: Mapping[str, float]) -> Arm:
    """By Pinocchio alone; package:// is sought in all folders above the file."""
    folders = [str(folder) for folder in path.resolve().parents]
    model = pin.buildModelFromUrdf(str(path))
    geometry = pin.buildGeomFromUrdf(model, str(path), pin.GeometryType.COLLISION, package_dirs=folders)
    pose = pin.neutral(model)
    for name, value in locked.items():
        joint = model.joints[model.getJointId(name)]
        pose[joint.idx_q] = value
    ids = [model.getJointId(name) for name in locked]
    model, geometry = pin.buildReducedModel(model, geometry, ids, pose)
    turns = np.array([joint.nq == 2 for joint in model.joints[1:]])  # continuous: cosine and sine
    first = np.array([joint.idx_q for joint in model.joints[1:]])
    lower = np.where(turns, -math.inf, model.lowerPositionLimit[first])
    upper = np.where(turns, math.inf, model.upperPositionLimit[first])
    massive = sum(inertia.mass for inertia in model.inertias) > 0.0
    effort = np.where(model.effortLimit > 0.0, model.effortLimit, np.inf)
    return Arm(model, geometry, lower, upper, model.velocityLimit, effort, massive)


def placed(model: pin.Model, q: np.ndarray) -> np.ndarray:
    """Pinocchio's configuration of joint positions (n,)."""
    result = np.empty(model.nq)
    for joint, angle in zip(model.joints[1:], q, strict=True):
        result[joint.idx_q : joint.idx_q + joint.nq] = [math.cos(angle), math.sin(angle)][: joint.nq]
        if joint.nq == 1:
            result[joint.idx_q] = angle
    return result


def load_table(path: Path) -> Arm:
    """A DH table, built joint by joint."""
    table = tomllib.loads(path.read_text(encoding="utf-8"))
    degree = math.pi / 180.0 if table.get("units") == "deg" else 1.0
    model, geometry = pin.Model(), pin.GeometryModel()
    model.gravity.linear = np.array(table.get("gravity", [0.0, 0.0, -9.81]))
    base = table.get("base", {})
    turn = pin.rpy.rpyToMatrix(*(_angle(a, degree) for a in base.get("rpy", (0.0, 0.0, 0.0))))
    rest = pin.SE3(turn, np.array(base.get("xyz", (0.0, 0.0, 0.0)), dtype=float))
    _add_capsules(geometry, 0, rest, table, "base")
    parent, limits = 0, []
    for number, row in enumerate(table["joint"], 1):
        slides = row.get("kind") == "prismatic"
        before, after = _row(row, table["convention"], degree)
        placement = rest * before
        kind = pin.JointModelPZ() if slides else pin.JointModelRZ()
        parent = model.addJoint(parent, kind, placement, row["name"])
        unit = 1.0 if slides else degree
        low, high = (value * unit for value in row["position"])
        limits.append((low, high, row["velocity"] * unit, row.get("effort", math.inf)))
        if "inertial" in row:
            body = row["inertial"]
            of = body.get("inertia", {})
            xx, xy, xz, yy, yz, zz = (of.get(key, 0.0) for key in ("xx", "xy", "xz", "yy", "yz", "zz"))
            tensor = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
            model.appendBodyToJoint(
                parent, pin.Inertia(body["mass"], np.array(body["com"], dtype=float), tensor), after
            )
        _add_capsules(geometry, parent, after, row, f"link_{number}")
        rest = after
    low, high, velocity, effort = np.array(limits).T
    return Arm(model, geometry, low, high, velocity, effort, any("inertial" in row for row in table["joint"]))


def _row(row: dict, convention: str, degree: float) -> tuple[pin.SE3, pin.SE3]:
    """Transforms before a joint turns or slides and after."""
    angles = {key: _angle(row.get(key, 0.0), degree) for key in ("alpha", "theta", "phi", "psi")}
    if convention == "thesis":
        turn = np.eye(3)
        for axis, key in (("z", "phi"), ("x", "theta"), ("z", "psi")):
            turn = turn @ pin.utils.rotate(axis, angles[key])
        return pin.SE3(turn, np.array([0.0, row.get("d_y", 0.0), row.get("d_z", 0.0)])), pin.SE3.Identity()
    side = pin.SE3(pin.utils.rotate("x", angles["alpha"]), np.array([row.get("a", 0.0), 0.0, 0.0]))
    up = pin.SE3(pin.utils.rotate("z", angles["theta"]), np.array([0.0, 0.0, row.get("d", 0.0)]))
    return (side * up, pin.SE3.Identity()) if convention == "modified" else (up, side)


def _angle(value: float | str, degree: float) -> float:
    """A number in the table's units, or something like -pi/2."""
    if not isinstance(value, str):
        return value * degree
    sign = -1.0 if value.strip().startswith("-") else 1.0
    parts = value.strip().lstrip("+-").split("/")
    factor = parts[0].replace("pi", "").strip(" *")
    return sign * (float(factor) if factor else 1.0) * math.pi / (float(parts[1]) if len(parts) > 1 else 1.0)


def _add_capsules(geometry: pin.GeometryModel, joint: int, frame: pin.SE3, row: dict, name: str) -> None:
    for number, body in enumerate(row.get("capsule", ())):
        a, b = np.array(body["from"], dtype=float), np.array(body["to"], dtype=float)
        turn = np.eye(3)
        if np.linalg.norm(b - a) > 0.0:
            turn = pin.Quaternion.FromTwoVectors(np.array([0.0, 0.0, 1.0]), b - a).toRotationMatrix()
        shape = coal.Capsule(body["radius"], float(np.linalg.norm(b - a)))
        placed = frame * pin.SE3(turn, 0.5 * (a + b))
        geometry.addGeometryObject(pin.GeometryObject(f"{name}_{number}", joint, placed, shape))


def fly(
    arm: Arm, plan: Path, *, floor: float | None, clearance: float, rate: float = 1000.0,
    acceleration: float = math.inf, jerk: float = math.inf, torque: float = 0.9,
) -> Flight:  # fmt: skip
    """Look at everything at `rate` samples a second.

    Args:
        arm: Model, bodies, limits.
        plan: The `plan.json`.
        floor: Height of the floor [m].
        clearance: Distance that bodies keep [m].
        rate: Samples a second [Hz].
        acceleration: Limit of every joint.
        jerk: Limit of every joint.
        torque: Share of the effort limits that may be used.
    """
    series = json.loads(plan.read_text(encoding="utf-8"))
    w, a, b = series["base_frequency"], np.array(series["a"]), np.array(series["b"])
    f = w * np.arange(1, a.shape[1] + 1)
    t = np.arange(round(2.0 * math.pi / w * rate) + 1) / rate
    s, c = np.sin(np.outer(t, f)), np.cos(np.outer(t, f))
    q = np.array(series["offset"]) + s @ (a / f).T - c @ (b / f).T
    dq, ddq = c @ a.T + s @ b.T, c @ (b * f).T - s @ (a * f).T
    dddq = -c @ (a * f**2).T - s @ (b * f**2).T
    seen = Flight(samples=len(t))
    ends = np.isfinite(arm.upper - arm.lower)
    middle, half = 0.5 * (arm.upper + arm.lower)[ends], 0.5 * (arm.upper - arm.lower)[ends]
    seen.shares = {
        "position": float((np.abs(q[:, ends] - middle) / half).max(initial=0.0)),
        "velocity": float((np.abs(dq) / arm.velocity).max()),
        "acceleration": float(np.abs(ddq).max() / acceleration),
        "jerk": float(np.abs(dddq).max() / jerk),
        "rest": 1.0 + float(np.abs([dq[0], ddq[0]]).max()),
    }
    data = arm.model.createData()
    if arm.massive:
        effort = np.array(
            [pin.rnea(arm.model, data, placed(arm.model, x), v, y) for x, v, y in zip(q, dq, ddq, strict=True)]
        )
        seen.shares["torque"] = float((np.abs(effort) / (torque * arm.effort)).max())
    _Watch(arm, floor, clearance).look(q, seen)
    return seen


class _Watch:
    """Pairs of bodies that are not next to each other, less those that touch by construction."""

    def __init__(self, arm: Arm, floor: float | None, clearance: float) -> None:
        self.model, self.geometry = arm.model, arm.geometry
        if floor is not None:
            slab = pin.SE3(np.eye(3), np.array([0.0, 0.0, floor - 0.5 * THICK]))
            self.geometry.addGeometryObject(pin.GeometryObject("floor", 0, slab, coal.Box(20.0, 20.0, THICK)))
        self.bodies = list(self.geometry.geometryObjects)
        self.above = [set(self.model.supports[k]) - {0} for k in range(self.model.njoints)]
        self.geometry.removeAllCollisionPairs()
        pairs = [pin.CollisionPair(j, i) for i in range(len(self.bodies)) for j in range(i)]
        for pair in pairs:
            if self.between(pair) > 1 or (self.floor(pair) and self.between(pair) == 1):
                self.geometry.addCollisionPair(pair)
        self.data, self.gaps = self.model.createData(), self.geometry.createData()
        self.around = self.geometry.copy()
        for body in self.around.geometryObjects:
            if isinstance(body.geometry, coal.BVHModelOBBRSS):
                body.geometry.buildConvexHull(True, "Qt")
                body.geometry = body.geometry.convex
        self.hulls = self.around.createData()
        for gaps in (self.gaps, self.hulls):
            for request in gaps.collisionRequests:
                request.security_margin = clearance - ROUNDING
        self.skip = np.zeros(len(self.geometry.collisionPairs), dtype=bool)
        rng = np.random.default_rng(0)
        low, high = np.maximum(arm.lower, -math.pi), np.minimum(arm.upper, math.pi)
        usual = np.mean([self.touching(pose) for pose in rng.uniform(low, high, (LOOKED, self.model.nv))], axis=0)
        self.skipped: list[str] = []
        for k, pair in enumerate(self.geometry.collisionPairs):
            beside = self.between(pair) <= (1 if self.floor(pair) else NEIGHBOURS)
            always = usual[k] >= ALWAYS and not self.floor(pair)
            if always or (beside and usual[k] > CONSTRUCTION):
                self.skip[k] = True
                self.skipped.append(self.name(k))

    def between(self, pair: pin.CollisionPair) -> int:
        """Joints between the bodies of a pair."""
        one, two = (self.bodies[i].parentJoint for i in (pair.first, pair.second))
        return len(self.above[one] ^ self.above[two])

    def floor(self, pair: pin.CollisionPair) -> bool:
        """Tell whether one of a pair is the floor."""
        return "floor" in (self.bodies[pair.first].name, self.bodies[pair.second].name)

    def name(self, k: int) -> str:
        """Of a pair."""
        pair = self.geometry.collisionPairs[k]
        return " - ".join(self.bodies[i].name for i in (pair.first, pair.second))

    def touching(self, pose: np.ndarray) -> np.ndarray:
        """Tell which pairs are too close in a pose, shape (m,)."""
        q = placed(self.model, pose)
        near = self._found(self.around, self.hulls, q, ~self.skip)
        return self._found(self.geometry, self.gaps, q, near) if near.any() else near

    def _found(
        self, geometry: pin.GeometryModel, gaps: pin.GeometryData, q: np.ndarray, ask: np.ndarray
    ) -> np.ndarray:
        """Tell which of the pairs asked for are too close, shape (m,)."""
        for k in np.flatnonzero(ask):
            gaps.activateCollisionPair(int(k))
        for k in np.flatnonzero(~ask):
            gaps.deactivateCollisionPair(int(k))
        pin.computeCollisions(self.model, self.data, geometry, gaps, q, False)
        results = gaps.collisionResults
        return np.array([bool(ask[k]) and results[k].isCollision() for k in range(len(results))], dtype=bool)

    def look(self, q: np.ndarray, seen: Flight) -> None:
        """Every pose."""
        seen.skipped, seen.pairs = self.skipped, len(self.geometry.collisionPairs) - len(self.skipped)
        for pose in q:
            for k in np.flatnonzero(self.touching(pose)):
                seen.close[self.name(int(k))] = seen.close.get(self.name(int(k)), 0) + 1
