"""Arm in the form of the kernel: a tree of joints, each with one degree of freedom."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from armid.checked_array import Array, array
from armid.errors import RobotError


@dataclass(frozen=True, eq=False, slots=True)
class Tree:
    """Constant geometry of a tree of n joints, ordered so that every parent joint comes before its children.

    Frame i is fixed to link i. At q_i = 0, the pose of frame i in frame parent_i is (rotation_i, translation_i). A
    revolute joint rotates frame i about `axis_i`; a prismatic joint translates it along `axis_i`.

    Attributes:
        parent: Index of the parent joint, -1 for the base, shape (n,).
        prismatic: Mask of the prismatic joints, shape (n,).
        axis: Unit vector of the axis of joint i in frame i, shape (n, 3).
        rotation: Rotation matrix of frame i in frame parent_i at q_i = 0, shape (n, 3, 3).
        translation: Origin of frame i in frame parent_i at q_i = 0, shape (n, 3) [m].
        gravity: Acceleration of gravity in the base frame, shape (3,) [m/s²].
    """

    parent: NDArray[np.int32]
    prismatic: NDArray[np.uint8]
    axis: Array
    rotation: Array
    translation: Array
    gravity: Array

    def __post_init__(self) -> None:
        parent = np.array(self.parent, dtype=np.int32)
        n = len(parent)
        prismatic = np.array(self.prismatic, dtype=np.uint8)
        parent.setflags(write=False)
        prismatic.setflags(write=False)
        axis = array(self.axis, (n, 3), "axis")
        set_ = object.__setattr__
        set_(self, "parent", parent)
        set_(self, "prismatic", prismatic)
        set_(self, "axis", axis)
        set_(self, "rotation", array(self.rotation, (n, 3, 3), "rotation"))
        set_(self, "translation", array(self.translation, (n, 3), "translation"))
        set_(self, "gravity", array(self.gravity, (3,), "gravity"))
        if n == 0 or prismatic.shape != (n,):
            raise RobotError(
                f"A kinematic tree needs at least one joint, and one entry of `prismatic` for each joint; found {n} "
                f"joints and {prismatic.size} entries."
            )
        if any(not -1 <= p < i for i, p in enumerate(parent)):
            raise RobotError(f"Parents must come before their children; found parents {parent.tolist()}.")
        if np.abs(np.linalg.norm(axis, axis=1) - 1.0).max() > UNIT_TOLERANCE:
            lengths = np.linalg.norm(axis, axis=1).tolist()
            raise RobotError(f"Every joint axis must be a vector of unit length; found the lengths {lengths}.")

    @property
    def n(self) -> int:
        """Number of joints."""
        return len(self.parent)

    def ancestors(self, i: int) -> list[int]:
        """Indices of all joints from the base to joint i, including i."""
        chain: list[int] = []
        while i >= 0:
            chain.append(i)
            i = int(self.parent[i])
        return chain[::-1]

    def subtree(self, i: int) -> list[int]:
        """Indices of all joints that joint i carries, including i, in ascending order."""
        carried = [False] * self.n
        for k in range(i, self.n):
            carried[k] = k == i or (self.parent[k] >= 0 and carried[self.parent[k]])
        return [k for k in range(self.n) if carried[k]]


UNIT_TOLERANCE = 1e-12
"""Largest deviation of the length of an axis from 1. The axes have been normalised before, so only rounding errors
remain."""
