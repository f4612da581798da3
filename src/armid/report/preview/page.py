"""Page of an animated arm, one file that needs no network."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from importlib.metadata import version
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np

from armid.checked_array import Array
from armid.errors import Finding
from armid.excitation.collision.collision_model import CollisionOptions
from armid.excitation.limits.joint_limits import Limits, described_limits
from armid.report.page_file import write_html
from armid.report.plots.arm_picture import POSES, skeleton
from armid.report.plots.encoding import compressed, embedded, packed
from armid.report.preview.animation_frames import Clip
from armid.report.preview.inertia_ellipsoids import MassLayer
from armid.report.preview.nearest_bodies import NearestBodies, closest
from armid.report.preview.scene import bodies_of, joint_records, open_side, reach_of, surroundings_of
from armid.report.rendering import environment, require_extra, security_policy, text_of
from armid.robot.kinematics import forward_kinematics, frame_pose
from armid.robot.robot import Robot
from armid.robot.shapes import Shape


@dataclass(frozen=True, eq=False, slots=True)
class Preview:
    """Content of a preview.

    Attributes:
        robot: The arm, with bodies if the description has them.
        clip: The motion.
        surroundings: Bodies that do not move.
        collision: Bodies and pairs to check for collisions; `None` if collisions are not checked.
        layers: Inertias of the links, one layer for each source (description or run).
        collision_note: Verdict of the collision check of a plan, or the reason why there was no check.
        limits: Limits of the joints with which a plan was designed; `None` for the limits of the description.
    """

    robot: Robot
    clip: Clip
    surroundings: tuple[Shape, ...] = ()
    collision: CollisionOptions | None = None
    layers: Sequence[MassLayer] = ()
    collision_note: str = ""
    limits: Limits | None = None


def write_preview(preview: Preview, path: Path | str) -> tuple[Path, tuple[Finding, ...]]:
    """Writes the page of a preview completely or not at all.

    Returns:
        The file, and findings about bodies of the arm that the page does not show.

    Raises:
        MissingExtraError: jinja2 is not installed.
        ArmidError: A mesh cannot be read, or the file cannot be written.
    """
    require_extra("jinja2")
    html, missing = _page(preview)
    return write_html(path, html), missing


def render_preview(preview: Preview) -> str:
    """HTML of the page of a preview."""
    return _page(preview)[0]


def _page(preview: Preview) -> tuple[str, tuple[Finding, ...]]:
    """HTML of the page of a preview, and findings about bodies that are not drawn."""
    robot, clip = preview.robot, preview.clip
    approach = None if preview.collision is None else closest(robot, clip, preview.collision)
    record, missing = _scene(preview, approach)
    subtitle = clip.title + (f", {clip.time[-1]:.1f} s" if len(clip.time) > 1 else "")
    script = text_of("unpack.js") + text_of("preview/view.js") + text_of("preview/preview.js")
    three = (files("armid.report") / "vendor" / "three.min.js").read_text(encoding="utf-8")
    html = (
        environment()
        .get_template("preview/preview.html")
        .render(
            title=robot.name,
            subtitle=subtitle,
            joints=[(joint.name, joint.unit) for joint in robot.joints],
            layers=[(k, layer.name, layer.note) for k, layer in enumerate(preview.layers)],
            measured=approach is not None,
            constant="" if approach is None else _constant_text(approach),
            collision_note=preview.collision_note,
            designed_limits=preview.limits is not None,
            has_bodies=bool(record["bodies"]),
            missing=[f"{f.channel}: {f.evidence}" if f.channel else f.evidence for f in missing],
            bare=not record["bodies"] or bool(missing),
            skeleton=skeleton(robot, clip.q[:: max(1, len(clip.q) // POSES)]),
            version=version("armid"),
            style=text_of("theme.css") + text_of("preview/preview.css"),
            script=script,
            policy=security_policy(script, three),
            data=embedded(record),
            three=compressed(three),
        )
    )
    return html, missing


def _scene(preview: Preview, approach: NearestBodies | None) -> tuple[dict[str, Any], tuple[Finding, ...]]:
    """Data for the page's script, and findings about bodies that could not be drawn."""
    robot, clip = preview.robot, preview.clip
    bodies, meshes, missing = bodies_of(robot)
    _, path = frame_pose(robot, clip.q)
    _, origins = forward_kinematics(robot, clip.q)
    record = {
        "joints": joint_records(robot, preview.limits or described_limits(robot)),
        "tip": {"link": robot.tip.parent, "placement": robot.tip.placement.T.ravel().tolist()},
        "down": _down(robot.gravity),
        "reach": reach_of(path, origins),
        "side": open_side(robot, origins),
        "bodies": bodies,
        "meshes": meshes,
        "surroundings": surroundings_of(robot, preview.surroundings),
        "layers": [layer.record([link.name for link in robot.links]) for layer in preview.layers],
        "duration": float(clip.time[-1]),
        "q": packed(clip.q),
        "dq": packed(clip.dq),
        "path": packed(path),
        "approach": None if approach is None else _approach_record(approach),
    }
    return record, missing


def _approach_record(approach: NearestBodies) -> dict[str, Any]:
    used, index = np.unique(approach.pair, return_inverse=True)
    return {
        "pairs": [approach.pairs[k] for k in used],
        "pair": packed(index, "u2"),
        "distance": packed(approach.distance),
        "points": packed(approach.points),
    }


def _constant_text(approach: NearestBodies) -> str:
    """Sentence that names the pairs of constant distance; empty if there are none."""
    pairs = "; ".join(f"{pair} {1000.0 * distance:.1f} mm" for pair, distance in approach.constant)
    return (
        f"Not in the chart are neighbouring links at a nearly constant distance (it varies by 3 mm at most): {pairs}."
        if pairs
        else ""
    )


def _down(gravity: Array) -> list[float]:
    """Direction of gravity, a unit vector in the base frame; -z of the base if there is no gravity."""
    size = float(np.linalg.norm(gravity))
    return (gravity / size).tolist() if size > 0.0 else [0.0, 0.0, -1.0]
