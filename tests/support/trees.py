"""Makers of random and structured trees, bodies and states, shared by the tests."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from armid.checked_array import Array
from armid.kernel.tree import Tree
from armid.maths.inertia import vector_from_pseudo_inertia
from armid.maths.rotations import homogeneous, rotation_x, rotation_z
from armid.robot.robot import Frame, Joint, Link, Robot

RIGHT_ANGLES = tuple(np.rint(r.as_matrix()) for r in Rotation.create_group("O"))
"""The 24 rotations that map axes to axes, exact."""


def random_parents(rng: np.random.Generator, n: int, branching: float) -> list[int]:
    """Parents of n joints: the joint before, or now and then any earlier one or the base."""
    return [i - 1 if i == 0 or rng.random() > branching else int(rng.integers(-1, i)) for i in range(n)]


def random_rotation(rng: np.random.Generator) -> Array:
    return Rotation.random(random_state=int(rng.integers(2**31))).as_matrix()


def random_direction(rng: np.random.Generator) -> Array:
    v = rng.normal(size=3)
    v /= np.linalg.norm(v)
    return v / np.linalg.norm(v)


def random_tree(rng: np.random.Generator, n: int, *, prismatic: float = 0.3, branching: float = 0.2) -> Tree:
    """A tree without any special geometry; `prismatic` and `branching` are probabilities."""
    return Tree(
        parent=random_parents(rng, n, branching),
        prismatic=rng.random(n) < prismatic,
        axis=[random_direction(rng) for _ in range(n)],
        rotation=[random_rotation(rng) for _ in range(n)],
        translation=rng.uniform(-0.5, 0.5, (n, 3)),
        gravity=9.81 * random_direction(rng),
    )


def structured_tree(rng: np.random.Generator, n: int, *, prismatic: float = 0.25, branching: float = 0.2) -> Tree:
    """A tree as machines are: right angles, parallel and intersecting axes, special directions of gravity.

    Half of the trees turn all axes about one direction (planar) or leave frames unturned (gantries).
    """
    style = rng.choice(["any", "any", "planar", "unturned", "oblique"])
    about_z = [r for r in RIGHT_ANGLES if r[2, 2] == 1.0]
    rotations, axes, translations = [], [], []
    for _ in range(n):
        axes.append(rng.choice([-1.0, 1.0]) * np.eye(3)[rng.integers(3) if style in ("any", "unturned") else 2])
        if style == "planar":
            rotations.append(about_z[rng.integers(4)])
        elif style == "unturned":
            rotations.append(np.eye(3))
        elif style == "oblique" and rng.random() < 0.3:
            rotations.append(Rotation.from_euler("xyz", rng.choice([0, 30, 45, 60, 90], 3), degrees=True).as_matrix())
        else:
            rotations.append(RIGHT_ANGLES[rng.integers(24)])
        translations.append(rng.choice([0.0, 0.0, 0.1, 0.25, -0.4], 3))
    g = 9.81 * np.array([[0, 0, -1], [0, 0, 1], [0, 1, 0], [1, 0, 0], [0, 0.6, -0.8], [0, 0, 0]])
    return Tree(
        parent=random_parents(rng, n, branching),
        prismatic=rng.random(n) < prismatic,
        axis=axes,
        rotation=rotations,
        translation=translations,
        gravity=g[rng.integers(len(g))],
    )


def random_inertial(rng: np.random.Generator, n: int) -> Array:
    """Inertial parameters (n, 10) of bodies that can exist."""
    factor = rng.normal(size=(n, 4, 4)) * np.array([0.2, 0.2, 0.2, 1.0])[:, None]
    return vector_from_pseudo_inertia(factor @ np.swapaxes(factor, 1, 2) + 1e-3 * np.eye(4))


def random_states(rng: np.random.Generator, samples: int, n: int) -> tuple[Array, Array, Array]:
    """q, dq, ddq (samples, n)."""
    return (
        rng.uniform(-np.pi, np.pi, (samples, n)),
        rng.uniform(-2.0, 2.0, (samples, n)),
        rng.uniform(-4.0, 4.0, (samples, n)),
    )


def pinocchio_model(tree: Tree, inertial: Array) -> tuple[Any, list[int]]:
    """The tree in Pinocchio, which wants joints depth first: joint k there is joint `order[k]` here."""
    import pinocchio as pin

    order: list[int] = []

    def visit(i: int) -> None:
        order.append(i)
        for k in np.flatnonzero(tree.parent == i):
            visit(int(k))

    for root in np.flatnonzero(tree.parent == -1):
        visit(int(root))
    model = pin.Model()
    model.gravity = pin.Motion(tree.gravity, np.zeros(3))
    for i in order:
        kind = pin.JointModelPrismaticUnaligned if tree.prismatic[i] else pin.JointModelRevoluteUnaligned
        parent = order.index(tree.parent[i]) + 1 if tree.parent[i] >= 0 else 0
        placement = pin.SE3(tree.rotation[i], tree.translation[i])
        joint = model.addJoint(parent, kind(tree.axis[i]), placement, f"joint_{i}")
        model.appendBodyToJoint(joint, pin.Inertia.FromDynamicParameters(inertial[i]), pin.SE3.Identity())
    return model, order


def robot_of(tree: Tree, name: str = "arm") -> Robot:
    """A robot with this geometry and joints named joint_1, joint_2, …"""
    joints = [
        Joint(
            f"joint_{i + 1}",
            "prismatic" if tree.prismatic[i] else "revolute",
            int(tree.parent[i]),
            tree.axis[i],
            homogeneous(tree.rotation[i], tree.translation[i]),
            (-3.0, 3.0),
            5.0,
            100.0,
        )
        for i in range(tree.n)
    ]
    links = [Link(f"link_{i + 1}") for i in range(tree.n)]
    return Robot(name, joints, links, Frame("tip", tree.n - 1, np.eye(4)), tree.gravity)


def chain(kinds: str, rotations: list[Array], translations: list[list[float]], gravity: list[float]) -> Tree:
    """A serial arm with all axes along z; `kinds` is a word of R and P."""
    return Tree(
        parent=range(-1, len(kinds) - 1),
        prismatic=[kind == "P" for kind in kinds],
        axis=[[0.0, 0.0, 1.0]] * len(kinds),
        rotation=rotations,
        translation=translations,
        gravity=gravity,
    )


def iiwa_tree(gravity: tuple[float, float, float] = (0.0, 0.0, 9.81)) -> Tree:
    """Table 3.1 of the thesis: shift by d_n along z or y, then turn by φ about z and by θ about x."""
    d = (0.1575, 0.2025, 0.2045, 0.2155, 0.1845, 0.2155, 0.081)
    along = (2, 2, 1, 2, 1, 2, 1)
    phi = (0.0, -np.pi, np.pi, 0.0, np.pi, 0.0, np.pi)
    theta = (0.0, *(np.pi / 2,) * 6)
    rotations = [rotation_z(p) @ rotation_x(t) for p, t in zip(phi, theta, strict=True)]
    return chain("RRRRRRR", rotations, [(d[i] * np.eye(3)[along[i]]).tolist() for i in range(7)], list(gravity))
