"""Picture of the arm with numbered joints, as SVG in the colours of the page."""

from __future__ import annotations

from html import escape

import numpy as np

from armid.checked_array import Array
from armid.report.data.joint_names import label_of
from armid.report.data.page_data import PageData
from armid.robot import Robot
from armid.robot.kinematics import forward_kinematics, frame_pose

SIZE = 240.0
"""Width and height of the picture [px]."""

MARGIN = 26.0
"""Margin around the arm for the marks of the joints [px]."""

AZIMUTH, ELEVATION = np.radians(35.0), np.radians(18.0)
"""Azimuth and elevation of the direction of view [rad]: slightly from above, so that all three axes are visible."""

POSES = 200
"""Number of poses of each recording among which the pose with the largest projected area is chosen."""

RADIUS = 8.0
"""Radius of the mark of a joint [px]; joints whose marks would overlap have a common mark."""

RULERS = (0.05, 0.1, 0.2, 0.5, 1.0, 2.0)
"""Possible lengths of the scale bar [m]; the largest length below a third of the width of the picture is used."""


def picture_of(page_data: PageData) -> tuple[str, str]:
    """Picture of the arm in its most extended recorded pose, and the picture's caption."""
    robot = page_data.run.robot
    poses = [each.q[:: max(1, len(each.q) // POSES)] for each in page_data.of_role("train")]
    caption = "in a pose of the training motion" if poses else "in the middle of its ranges"
    q = np.concatenate(poses) if poses else _middle(robot)[None]
    return skeleton(robot, q), f"{robot.name} {caption}"


def skeleton(robot: Robot, poses: Array) -> str:
    """SVG of the arm's joints and the lines between them.

    Args:
        robot: The arm.
        poses: K poses, shape (K, n) [rad or m]; the pose with the largest projected area is drawn.
    """
    view = _view(robot)
    _, origins = forward_kinematics(robot, poses)
    _, tips = frame_pose(robot, poses)
    points = np.concatenate([np.zeros((len(poses), 1, 3)), origins, tips[:, None]], axis=1) @ view.T
    pairs = [(joint.parent + 1, i + 1) for i, joint in enumerate(robot.joints)]
    pairs.append((robot.tip.parent + 1, robot.n + 1))
    flat = points[:, :, :2] - points[:, :, :2].mean(axis=1, keepdims=True)
    area = np.linalg.svd(flat, compute_uv=False).prod(axis=-1)
    return _drawn(robot, points[int(np.argmax(area))], pairs)


def _drawn(robot: Robot, points: Array, pairs: list[tuple[int, int]]) -> str:
    """SVG of base, n joints and tip at points (n + 2, 3) [m], whose axes are right, up and towards the viewer."""
    low, high = points[:, :2].min(axis=0), points[:, :2].max(axis=0)
    scale = (SIZE - 2.0 * MARGIN) / max(float((high - low).max()), 1e-3)
    middle = 0.5 * (low + high)
    place = 0.5 * SIZE + scale * (points[:, :2] - middle) * np.array([1.0, -1.0])
    lines = [f'<ellipse class="ground" cx="{place[0, 0]:.1f}" cy="{place[0, 1]:.1f}" rx="26" ry="8"/>']
    for start, end in sorted(pairs, key=lambda pair: float(points[list(pair), 2].mean())):
        (x0, y0), (x1, y1) = place[start], place[end]
        kind = "tip" if end == robot.n + 1 else "link"
        lines.append(f'<line class="{kind}" x1="{x0:.1f}" y1="{y0:.1f}" x2="{x1:.1f}" y2="{y1:.1f}"/>')
    x, y = place[-1]
    lines.append(f'<circle class="tip" cx="{x:.1f}" cy="{y:.1f}" r="3.5"/>')
    lines += _marks(robot, place[1:-1])
    ruler = max((each for each in RULERS if each * scale < SIZE / 3.0), default=RULERS[0])
    end = 8.0 + ruler * scale
    lines.append(f'<path class="ruler" d="M8 {SIZE - 10:.0f} v4 H{end:.1f} v-4"/>')
    lines.append(f'<text class="ruler" x="{end + 5:.1f}" y="{SIZE - 5:.0f}">{ruler:g} m</text>')
    names = ", ".join(label_of(robot.joints, j) for j in range(robot.n))
    return (
        f'<svg class="arm" viewBox="0 0 {SIZE:.0f} {SIZE:.0f}" role="img" '
        f'aria-label="{escape(f"Joints of {robot.name}: {names}", quote=True)}">{"".join(lines)}</svg>'
    )


def _marks(robot: Robot, place: Array) -> list[str]:
    """Marks with the numbers of joints at places (n, 2); joints that coincide in the picture have a common mark."""
    groups: list[list[int]] = []
    for j, at in enumerate(place):
        near = next((g for g in groups if np.linalg.norm(place[g].mean(axis=0) - at) < 2.0 * RADIUS), None)
        if near is None:
            groups.append([j])
        else:
            near.append(j)
    marks: list[str] = []
    for group in groups:
        x, y = place[group].mean(axis=0)
        half = RADIUS + 4.5 * (len(group) - 1)
        round_ = 2.0 if all(robot.joints[j].is_prismatic for j in group) else RADIUS
        names = escape(", ".join(label_of(robot.joints, j) for j in group))
        marks.append(
            f'<g class="joint"><title>{names}</title><rect x="{x - half:.1f}" y="{y - RADIUS:.1f}" '
            f'width="{2 * half:.1f}" height="{2 * RADIUS:.0f}" rx="{round_:.0f}"/>'
            f'<text x="{x:.1f}" y="{y + 3.6:.1f}">{" ".join(str(j + 1) for j in group)}</text></g>'
        )
    return marks


def _view(robot: Robot) -> Array:
    """Rotation (3, 3) from the base frame to the axes right, up (against gravity) and towards the viewer."""
    size = float(np.linalg.norm(robot.gravity))
    up = -robot.gravity / size if size > 0.0 else np.array([0.0, 0.0, 1.0])
    aside = np.eye(3)[int(np.argmin(np.abs(up)))]
    ahead = aside - (aside @ up) * up
    ahead /= np.linalg.norm(ahead)
    left = np.cross(up, ahead)
    level = np.cos(AZIMUTH) * ahead - np.sin(AZIMUTH) * left
    eye = np.cos(ELEVATION) * level + np.sin(ELEVATION) * up
    right = np.cross(up, eye)
    right /= np.linalg.norm(right)
    return np.array([right, np.cross(eye, right), eye], dtype=np.float64)


def _middle(robot: Robot) -> Array:
    """Pose near the middle of the range of each joint, shape (n,) [rad or m]; the middle is 0 without limits.

    The pose is 30 % of half the range away from the middle, but at most 0.6, so that the arm is not stretched.
    """
    limits = np.array([joint.position_limits for joint in robot.joints])
    known = np.isfinite(limits).all(axis=1)
    half = np.where(known, 0.5 * np.ptp(np.where(np.isfinite(limits), limits, 0.0), axis=1), np.pi)
    middle = np.where(known, np.where(np.isfinite(limits), limits, 0.0).mean(axis=1), 0.0)
    return middle + np.minimum(0.3 * half, 0.6)
