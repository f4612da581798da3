"""Which bodies could meet, and which of them a plan keeps apart: links with each other and with the surroundings."""

from __future__ import annotations

import tomllib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from armid.errors import ArmidError
from armid.excitation.capsules import covering
from armid.excitation.clearance import Bodies, Clearance
from armid.excitation.coal import distances, mesh_triangles
from armid.excitation.hulls import Hulls
from armid.excitation.limits import Limits
from armid.maths.spatial import homogeneous, rpy_rotation
from armid.robot.kinematics import forward_kinematics
from armid.robot.robot import Robot
from armid.robot.shapes import Shape, rotation_with_z
from armid.values import Array

__all__ = [
    "NEIGHBOURS",
    "Cell",
    "Collision",
    "LeftOut",
    "cell_of",
    "collision_of",
    "joints_between",
    "kept_apart",
    "load_environment",
    "pairs_of_bodies",
]

LOOKED = 3000
"""Random poses in which pairs are looked at, to leave out of a search those that never come near each other."""

MEASURED = 300
"""Of these, poses in which bodies are measured as they are, or by convex bodies closer around them than capsules."""

NEAR = 0.08
"""Distance beyond the margin [m] within which a pair in any of these poses takes part in the search."""

HALF, CERTIFICATE = 0.0005, 0.003
"""A search keeps beyond the margin what bodies come together in half a step of the certificate's grid [s] with all
joints at their fastest, so that the certificate need not draw the plan together; no more than so many metres."""

NEIGHBOURS = 2
"""Links so many joints apart may touch by construction."""

CONSTRUCTION = 0.5
"""Such links do so if they touch in more than this share of random poses; else they would touch by accident."""

ALWAYS = 0.99
"""Links any number of joints apart do so if they touch in this share of random poses or more: one lies within the
other, as a description with an elbow of two pieces has it, and a motion can do nothing about it."""


@dataclass(frozen=True, slots=True)
class LeftOut:
    """Two bodies that touch by construction and are not looked at.

    Attributes:
        pair: Their names.
        share: Of some random poses in which the bodies themselves are closer than what is asked, 0 to 1; what is
            around them is wider.
    """

    pair: str
    share: float

    @property
    def always(self) -> bool:
        """Whether no motion keeps them apart; others may meet, and nobody looks."""
        return self.share >= ALWAYS


@dataclass(frozen=True, eq=False, slots=True)
class Collision:
    """What a plan keeps apart.

    Attributes:
        searched: Pairs that could come near each other, for the search.
        every: All pairs, for the last word.
        skipped: Pairs that are not looked at.
        shapes: The bodies as they are, the surroundings last.
        pairs: Indices into `shapes` of the pairs of `every`, shape (m, 2).
        own: How many of the shapes are the arm's.
    """

    searched: Clearance | None
    every: Clearance
    skipped: tuple[LeftOut, ...]
    shapes: tuple[Shape, ...]
    pairs: NDArray[np.intp]
    own: int

    @property
    def surroundings(self) -> tuple[Shape, ...]:
        """Bodies that do not move."""
        return self.shapes[self.own :]


@dataclass(frozen=True, eq=False, slots=True)
class Cell:
    """An arm and its surroundings, with all pairs of bodies that a motion could bring together.

    Attributes:
        robot: The arm.
        shapes: The bodies as they are, the surroundings last.
        bodies: Capsules, solids, their pairs, and hulls for pairs whose capsules touch in most poses.
        pairs: Indices into `shapes` of these pairs, shape (m, 2).
        margin: Distance that stays between bodies [m].
        nearest: Least distance of each pair in many random poses, shape (m,) [m].
        touching: Share of these poses in which each pair is closer than the margin, shape (m,).
        constructed: Which pairs may touch by construction, shape (m,).
        tried: Some of these poses, shape (k, n).
        spare: What a search keeps beyond the margin, shape (m,) [m].
    """

    robot: Robot
    shapes: tuple[Shape, ...]
    bodies: Bodies
    pairs: NDArray[np.intp]
    margin: float
    nearest: Array
    touching: Array
    constructed: NDArray[np.bool_]
    tried: Array
    spare: Array

    def clear(self, q: Array) -> Array:
        """Least distance in poses (N, n) of pairs that do not touch by construction, less what is kept, (N,) [m]."""
        return (self.distances(q) - self.spare)[:, ~self.constructed].min(axis=1, initial=np.inf)

    def distances(self, q: Array) -> Array:
        """Distance of each pair in poses (N, n), shape (N, m) [m]."""
        return self.bodies.distances(forward_kinematics(self.robot, q))

    def closer(self, which: NDArray[np.intp]) -> Cell:
        """The same with some of the pairs, rising, measured by hulls where that finds them further apart."""
        hulls = Hulls(self.shapes, self.pairs[which], which)
        apart = hulls.distances(forward_kinematics(self.robot, self.tried))
        share = (apart < self.margin).mean(axis=0)
        better = share < self.touching[which]
        kept = np.union1d(self.bodies.hulls.at, which[better])
        touching, nearest = self.touching.copy(), self.nearest.copy()
        touching[which[better]], nearest[which[better]] = share[better], apart.min(axis=0)[better]
        return replace(
            self,
            bodies=replace(self.bodies, hulls=Hulls(self.shapes, self.pairs[kept], kept)),
            nearest=nearest,
            touching=touching,
            constructed=_constructed(self.robot, self.shapes, self.pairs, touching),
        )


def cell_of(robot: Robot, limits: Limits, surroundings: Sequence[Shape] = (), *, margin: float = 0.02) -> Cell:
    """An arm among bodies, looked at in many random poses.

    Raises:
        ArmidError: The description has no shapes, or the margin is negative.
    """
    if not robot.shapes:
        if any(finding.code == "mesh-missing" for finding in robot.findings):
            raise ArmidError(
                f"The meshes that say what space the links of {robot.name} take are not there, so collisions cannot "
                "be seen.",
                remedy="put them beside the description, in the folders that it names; or leave out --collision.",
            )
        raise ArmidError(
            f"The description of {robot.name} does not say what space its links take, so collisions cannot be seen.",
            remedy="give a URDF with <collision> bodies, or a DH table with capsules; or leave out --collision.",
        )
    if not margin >= 0.0:
        raise ArmidError(f"The distance that stays between bodies cannot be negative; found {margin} m.")
    shapes = (*robot.shapes, *surroundings)
    bodies, pairs = pairs_of_bodies(robot, shapes)
    low = np.where(np.isfinite(limits.lower), limits.lower, -np.pi)
    high = np.where(np.isfinite(limits.upper), limits.upper, np.pi)
    q = np.random.default_rng(0).uniform(low, high, (LOOKED, robot.n))
    poses = forward_kinematics(robot, q)
    distance = bodies.distances(poses)
    touching = (distance < margin).mean(axis=0)
    constructed = _constructed(robot, shapes, pairs, touching)
    nearest = distance.min(axis=0, initial=np.inf)
    some = poses[0][:MEASURED], poses[1][:MEASURED]
    fastest = bodies.approach(some, robot.tree, limits.velocity).max(axis=0) if len(pairs) else np.zeros(0)
    spare = np.minimum(HALF * fastest, CERTIFICATE)
    cell = Cell(robot, shapes, bodies, pairs, margin, nearest, touching, constructed, q[:MEASURED], spare)
    return cell.closer(np.flatnonzero(touching > CONSTRUCTION))


def _constructed(
    robot: Robot, shapes: Sequence[Shape], pairs: NDArray[np.intp], touching: Array
) -> NDArray[np.bool_]:
    """Which pairs (m, 2) may touch by construction, shape (m,), from the share of poses (m,) in which they do.

    Links two joints apart do where they touch in most poses, and any links where they touch in all. Nothing touches
    its surroundings by construction but the first link, which turns on what the arm is mounted on.
    """
    apart = np.array([joints_between(robot, *(shapes[i].link for i in pair)) for pair in pairs], dtype=np.intp)
    stands = np.array([_stands(robot, shapes, pair.max()) for pair in pairs], dtype=np.bool_)
    most = touching > CONSTRUCTION
    links = (touching >= ALWAYS) | (most & (apart <= NEIGHBOURS))
    return np.where(stands, most & (apart == 1), links)


def collision_of(
    robot: Robot, limits: Limits, start: Array, surroundings: Sequence[Shape] = (), *, margin: float = 0.02
) -> Collision:
    """Pairs of bodies that a plan must keep apart; see `kept_apart`."""
    return kept_apart(cell_of(robot, limits, surroundings, margin=margin), start)


def kept_apart(cell: Cell, start: Array) -> Collision:
    """Pairs of bodies that a plan from a start pose must keep apart.

    Links next to each other are no pair. Links two joints apart that are closer than the margin in the start pose,
    and in most other poses too, touch by construction, as a ball-shaped shoulder does, and so do links that touch in
    all other poses, however many joints apart. They are listed as skipped.

    Args:
        cell: The arm and its surroundings.
        start: The start pose, shape (n,) [rad or m].

    Raises:
        ArmidError: Bodies are too close to each other in the start pose.
    """
    distance, labels = cell.distances(start[None])[0], cell.bodies.labels
    wrong = np.flatnonzero((distance < cell.margin) & ~cell.constructed)
    if len(wrong):
        cell = cell.closer(np.setdiff1d(wrong, cell.bodies.hulls.at))
        distance = cell.distances(start[None])[0]
        wrong = np.flatnonzero((distance < cell.margin) & ~cell.constructed)
    close = (distance < cell.margin + cell.spare) & cell.constructed
    if len(wrong):
        k = int(wrong[distance[wrong].argmin()])
        raise ArmidError(
            f"In the start pose {labels[k]} are {1000 * max(distance[k], 0.0):.0f} mm apart, less than the "
            f"{1000 * cell.margin:.0f} mm that are asked.",
            remedy="choose another start pose with --start, a smaller --clearance, or move what is around.",
        )
    kept = np.flatnonzero(~close)
    every = cell.bodies.only(kept)
    near = np.flatnonzero(np.minimum(cell.nearest, distance)[kept] < cell.margin + NEAR)
    return Collision(
        Clearance("collision", every.only(near), cell.margin, cell.spare[kept][near]) if len(near) else None,
        Clearance("collision", every, cell.margin),
        _left_out(cell, np.flatnonzero(close)),
        cell.shapes,
        cell.pairs[kept],
        len(cell.robot.shapes),
    )


def _left_out(cell: Cell, which: NDArray[np.intp]) -> tuple[LeftOut, ...]:
    """Some of the pairs, with how often the bodies themselves are too close."""
    if not len(which):
        return ()
    apart = distances(cell.shapes, cell.pairs[which], forward_kinematics(cell.robot, cell.tried))
    shares = (apart < cell.margin).mean(axis=0)
    labels = cell.bodies.labels
    return tuple(LeftOut(labels[k], float(share)) for k, share in zip(which, shares, strict=True))


def pairs_of_bodies(robot: Robot, shapes: Sequence[Shape]) -> tuple[Bodies, NDArray[np.intp]]:
    """Capsules and solids with their pairs, and the pairs as indices into the shapes."""
    solid = [shape.kind in ("box", "half-space") and shape.link < 0 for shape in shapes]
    capsules: list[Shape] = []
    solids = [shape for shape, apart in zip(shapes, solid, strict=True) if apart]
    places: list[list[int]] = []
    for shape, apart in zip(shapes, solid, strict=True):
        made = () if apart else covering(shape, mesh_triangles(shape) if shape.kind == "mesh" else None)
        places.append(list(range(len(capsules), len(capsules) + len(made))))
        capsules += made
    for number, k in enumerate(np.flatnonzero(solid)):
        places[k] = [len(capsules) + number]
    chosen: list[tuple[int, int]] = []
    for a in range(len(shapes)):
        for b in range(a + 1, len(shapes)):
            nearest = 1 if _stands(robot, shapes, b) else 2
            apart = joints_between(robot, shapes[a].link, shapes[b].link)
            if apart >= nearest and not (solid[a] and solid[b]):
                chosen.append((b, a) if solid[a] else (a, b))
    own = [(i, j, group) for group, (a, b) in enumerate(chosen) for i in places[a] for j in places[b]]
    index = np.array(own, dtype=np.intp).reshape(-1, 3)
    bodies = Bodies(tuple(capsules), tuple(solids), index[:, :2], index[:, 2])
    return bodies, np.array(chosen, dtype=np.intp).reshape(-1, 2)


def _stands(robot: Robot, shapes: Sequence[Shape], k: int) -> bool:
    """Whether a body is one of the surroundings that no link carries."""
    return k >= len(robot.shapes) and shapes[k].link < 0


def joints_between(robot: Robot, a: int, b: int) -> int:
    """Joints on the way from one link to another."""
    above_a, above_b = ([*robot.tree.ancestors(k)] if k >= 0 else [] for k in (a, b))
    return len(set(above_a) ^ set(above_b))


ENVIRONMENT = {
    "box": ("name", "link", "size", "xyz", "rpy"),
    "sphere": ("name", "link", "radius", "xyz"),
    "half-space": ("name", "normal", "offset"),
}
"""Tables of an environment, and their keys."""


def load_environment(path: Path | str, robot: Robot) -> tuple[Shape, ...]:
    """Bodies that do not move, and such as links carry, from a TOML file.

    `[[box]]` has `size` [m], `xyz` of its middle and `rpy`; `[[sphere]]` has `radius` and `xyz`; `[[half-space]]`
    has a `normal` that points out of it and an `offset`, all in the base frame of the arm. Each has a `name`. A box
    or sphere with a `link`, for instance a tool, is carried by that link and stands in its frame.

    Args:
        path: The file.
        robot: The arm, for its links.

    Raises:
        ArmidError: The file is missing or says something else.
    """
    path = Path(path)
    try:
        document = tomllib.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise ArmidError(f"{path} is no environment: {error}.", remedy="give a TOML file.") from error
    shapes: list[Shape] = []
    for kind, tables in document.items():
        if kind not in ENVIRONMENT or not isinstance(tables, list):
            raise ArmidError(f"{path}: unknown entry {kind!r}.", possible=", ".join(f"[[{k}]]" for k in ENVIRONMENT))
        for number, table in enumerate(tables, 1):
            unknown = set(table) - set(ENVIRONMENT[kind])
            if unknown:
                raise ArmidError(
                    f"{path}: {kind} {number} has an unknown key {sorted(unknown)[0]!r}.",
                    possible=", ".join(ENVIRONMENT[kind]),
                )
            try:
                link = _carrier(robot, f"{path}: {kind} {number}", table.get("link"))
                shapes.append(replace(_surrounding(kind, number, table), link=link))
            except (TypeError, ValueError, KeyError) as error:
                raise ArmidError(
                    f"{path}: {kind} {number} lacks or garbles {error}.", possible=", ".join(ENVIRONMENT[kind])
                ) from error
    return tuple(shapes)


def _carrier(robot: Robot, where: str, name: str | None) -> int:
    """Index of the link of a name; -1 for the base, where nothing is said."""
    names = [link.name for link in robot.links]
    if name is None:
        return -1
    if name not in names:
        raise ArmidError(
            f"{where} is carried by {name!r}, which {robot.name} does not have.", possible=", ".join(names)
        )
    return names.index(name)


def _surrounding(kind: str, number: int, table: dict[str, Any]) -> Shape:
    """One body of an environment."""
    name = str(table.get("name", f"{kind} {number}"))
    if kind == "half-space":
        turned = rotation_with_z(np.array([float(x) for x in table["normal"]]))
        return Shape(name, -1, "half-space", np.zeros(3), homogeneous(turned, float(table["offset"]) * turned[:, 2]))
    turned = rpy_rotation([float(angle) for angle in table.get("rpy", (0.0, 0.0, 0.0))])
    placement = homogeneous(turned, [float(x) for x in table["xyz"]])
    if kind == "box":
        return Shape(name, -1, "box", np.array(table["size"], dtype=np.float64), placement)
    return Shape(name, -1, "sphere", np.array([float(table["radius"])]), placement)
