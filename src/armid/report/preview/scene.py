"""Scene of a preview: joints, bodies, meshes with a limited number of triangles, and surroundings."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from armid.checked_array import Array
from armid.errors import ArmidError, Finding
from armid.excitation.collision.coal import mesh_faces
from armid.excitation.limits.joint_limits import Limits
from armid.report.preview.mesh_simplification import MAX_TRIANGLES, mesh_record, simplified
from armid.robot.collision_body_names import link_of
from armid.robot.robot import Robot
from armid.robot.shapes import Shape

NOT_DRAWN = ("mesh-missing", "shape-unknown", "visual-left-out", "visual-missing")
"""Codes of findings about bodies that cannot be drawn."""

MIN_TRIANGLES = 300
"""Number of triangles that every mesh may have, regardless of the sizes of other meshes."""

BESIDE_BODY = 0.1
"""Ratio of the horizontal distance between the first joint and the centre of the fixed bodies to the length of the
arm, above which the arm is beside a body that can hide it."""

Bodies = tuple[list[dict[str, Any]], list[dict[str, Any]], tuple[Finding, ...]]
"""JSON objects of bodies and of their meshes for the script of the page, and findings about missing bodies."""


def joint_records(robot: Robot, limits: Limits) -> list[dict[str, Any]]:
    """JSON objects of the joints for the script of the page; unknown limits are null."""
    return [
        {
            "name": joint.name,
            "slides": joint.is_prismatic,
            "parent": joint.parent,
            "axis": joint.axis.tolist(),
            "placement": _columns(joint.placement),
            "unit": joint.unit,
            "low": _finite(float(limits.lower[j])),
            "high": _finite(float(limits.upper[j])),
            "fastest": _finite(float(limits.velocity[j])),
        }
        for j, joint in enumerate(robot.joints)
    ]


def bodies_of(robot: Robot) -> Bodies:
    """JSON objects of the visual shapes of the links, and of collision shapes for links without visual shapes."""
    with_visuals = {link_of(shape.name) for shape in robot.visuals}
    shapes = (*robot.visuals, *(shape for shape in robot.shapes if link_of(shape.name) not in with_visuals))
    drawn: list[dict[str, Any]] = []
    missing = [each for each in robot.findings if each.code in NOT_DRAWN]
    loaded: dict[tuple[str, tuple[float, ...]], Any] = {}
    for shape in shapes:
        if shape.kind == "half-space":
            continue
        key = shape.path, tuple(shape.size.tolist())
        if shape.kind == "mesh" and key not in loaded:
            try:
                loaded[key] = mesh_faces(shape)
            except ArmidError as error:
                missing.append(Finding("visual-left-out", "info", shape.name, error.problem, error.remedy))
                continue
        place = {"mesh": list(loaded).index(key)} if shape.kind == "mesh" else {"size": shape.size.tolist()}
        drawn.append(_record(shape) | place)
    return drawn, _within_budget(list(loaded.values())), tuple(missing)


def _within_budget(meshes: Sequence[tuple[Array, Any]]) -> list[dict[str, Any]]:
    """JSON objects of meshes simplified to about `MAX_TRIANGLES` in all, each to the same share of its triangles."""
    total = sum(len(triangles) for _, triangles in meshes)
    share = min(1.0, MAX_TRIANGLES / total) if total else 1.0
    return [
        mesh_record(*simplified(corners, triangles, max(MIN_TRIANGLES, int(share * len(triangles)))))
        for corners, triangles in meshes
    ]


def surroundings_of(robot: Robot, given: Sequence[Shape]) -> list[dict[str, Any]]:
    """JSON objects of fixed bodies for the script of the page: the given bodies, and planes of the description."""
    planes = [shape for shape in robot.visuals if shape.kind == "half-space"]
    return [_record(shape) | {"size": shape.size.tolist()} for shape in (*given, *planes) if shape.kind != "mesh"]


def reach_of(path: Array, origins: Array) -> float:
    """Largest distance of the arm from the base's origin [m], at least 0.1.

    Args:
        path: Positions of the tip in K poses, shape (K, 3) [m].
        origins: Origins of the links, shape (K, n, 3) [m].
    """
    far = max(float(np.linalg.norm(points, axis=-1).max(initial=0.0)) for points in (path, origins))
    return max(far, 0.1)


def open_side(robot: Robot, origins: Array) -> list[float] | None:
    """Horizontal direction from the fixed bodies to the first joint, shape (3,), in the base frame.

    From this side the arm of a humanoid is visible; from other sides the trunk or head can hide the arm. The result
    is `None` if the first joint is above or below the fixed bodies, for instance on a pedestal, because the arm is
    then visible from all sides.

    Args:
        robot: The arm.
        origins: Origins of the links, shape (K, n, 3) [m].
    """
    shapes = robot.visuals or robot.shapes
    fixed = [shape.placement[:3, 3] for shape in shapes if shape.link < 0 and shape.kind != "half-space"]
    if not fixed or not origins.size:
        return None
    size = float(np.linalg.norm(robot.gravity))
    up = -robot.gravity / size if size else np.array([0.0, 0.0, 1.0])
    side = origins[0, 0] - np.mean(fixed, axis=0)
    side = side - (side @ up) * up
    distance = float(np.linalg.norm(side))
    arm = float(np.linalg.norm(origins - origins[:, :1], axis=-1).max())
    return (side / distance).tolist() if distance > max(BESIDE_BODY * arm, 1e-6) else None


def _record(shape: Shape) -> dict[str, Any]:
    return {
        "name": shape.name,
        "link": shape.link,
        "kind": shape.kind,
        "placement": _columns(shape.placement),
    }


def _columns(placement: Array) -> list[float]:
    """Transform in column-major order, as WebGL needs it."""
    return placement.T.ravel().tolist()


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None
