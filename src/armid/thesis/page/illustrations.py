"""Drawings of Figures 2.1, 2.2, 2.3 and 3.1 of the thesis as SVG, in the colours of the page."""

from __future__ import annotations

from html import escape
from itertools import pairwise

import numpy as np

from armid.checked_array import Array
from armid.thesis.lagrange import make_frames
from armid.thesis.page.chapter_elements import Drawings
from armid.thesis.published import published

VIEW = np.array([[-0.5, 0.866, 0.0], [-0.25, -0.144, 0.957]])
"""Matrix (2, 3) that projects a point in space to the picture (right and up): x points towards the viewer and to the
left, y to the right, z up."""

UNIT = 62.0
"""Length of the drawing of a unit vector [px]."""

COLOURS = {"x": "var(--orange)", "y": "var(--blue)", "z": "var(--ink)"}
"""Colour of each axis of a frame. The axes also have their names, so that the drawing is clear without colours."""


class _Canvas:
    """Builder of an SVG drawing; positions of lines and texts are in pixels, with y downwards."""

    def __init__(self, width: float, height: float, label: str) -> None:
        self.width, self.height, self.label = width, height, label
        self.parts: list[str] = []

    def line(self, a: Array, b: Array, colour: str = "var(--ink)", width: float = 1.4, dash: str = "") -> None:
        dashed = f' stroke-dasharray="{dash}"' if dash else ""
        self.parts.append(
            f'<line x1="{a[0]:.1f}" y1="{a[1]:.1f}" x2="{b[0]:.1f}" y2="{b[1]:.1f}" stroke="{colour}" '
            f'stroke-width="{width}" stroke-linecap="round"{dashed}/>'
        )

    def arrow(self, a: Array, b: Array, colour: str = "var(--ink)", width: float = 1.6) -> None:
        along = (b - a) / max(float(np.linalg.norm(b - a)), 1e-9)
        across = np.array([-along[1], along[0]])
        self.line(a, b - 4.0 * along, colour, width)
        corners = (b, b - 8.0 * along + 3.2 * across, b - 8.0 * along - 3.2 * across)
        tip = " ".join(f"{x:.1f},{y:.1f}" for x, y in corners)
        self.parts.append(f'<polygon points="{tip}" fill="{colour}"/>')

    def text(self, at: Array, words: str, colour: str = "var(--ink)", anchor: str = "middle") -> None:
        self.parts.append(
            f'<text x="{at[0]:.1f}" y="{at[1]:.1f}" fill="{colour}" text-anchor="{anchor}" font-size="13">'
            f"{_lowered(words)}</text>"
        )

    def shape(self, path: str, fill: str = "var(--wash)") -> None:
        self.parts.append(f'<path d="{path}" fill="{fill}" stroke="var(--body-2)" stroke-width="1.5"/>')

    def frame(self, at: Array, R: Array, index: str, size: float = UNIT, *, names: bool = True) -> None:
        """Draws the axes of a frame; an axis towards the viewer is a dot.

        Args:
            at: Position of the origin, shape (2,) [px].
            R: Rotation of the frame, shape (3, 3).
            index: Index in the names of the axes.
            size: Length of the axes [px].
            names: False to leave out the names of the axes.
        """
        for k, axis in enumerate("xyz"):
            step = size * _flat(R[:, k])
            if float(np.linalg.norm(step)) < 4.0:
                self.parts.append(f'<circle cx="{at[0]:.1f}" cy="{at[1]:.1f}" r="3" fill="{COLOURS[axis]}"/>')
                continue
            self.arrow(at, at + step, COLOURS[axis])
            if names:
                self.text(at + step * (1.0 + 13.0 / size) + np.array([0.0, 4.0]), f"{axis}_{index}", COLOURS[axis])

    def svg(self) -> str:
        return (
            f'<svg viewBox="0 0 {self.width:.0f} {self.height:.0f}" role="img" width="{self.width:.0f}" '
            f'style="max-width:100%;height:auto" aria-label="{escape(self.label, quote=True)}">'
            f"{''.join(self.parts)}</svg>"
        )


def _lowered(words: str) -> str:
    """SVG text of a name with a subscript, such as `z_b`, or with subscript and superscript, such as `d_0^1`."""
    name, _, index = escape(words).partition("_")
    if not index:
        return name
    index, space, rest = index.partition(" ")
    low, _, high = index.partition("^")
    raised = f'<tspan dy="-8" font-size="9.5">{high}</tspan><tspan dy="4">​</tspan>' if high else ""
    back = "" if high else '<tspan dy="-4">​</tspan>'
    return f'{name}<tspan dy="4" font-size="9.5">{low}</tspan>{raised}{back}{space}{rest}'


def _flat(x: Array) -> Array:
    """Projects a vector (3,) to the picture; the result (2,) is to the right and downwards."""
    return VIEW @ x * np.array([1.0, -1.0])


def _turn(angles: tuple[float, float, float]) -> Array:
    """Rotation matrix (3, 3) of rotations about z, then y, then x by the given angles [rad]."""
    R = np.eye(3)
    for axis, angle in zip((2, 1, 0), angles, strict=True):
        one, other = [k for k in range(3) if k != axis]
        step = np.eye(3)
        step[one, one] = step[other, other] = np.cos(angle)
        step[one, other], step[other, one] = -np.sin(angle), np.sin(angle)
        R = R @ step
    return R


def foundations() -> Drawings:
    """Draws Figures 2.1, 2.2 and 2.3 of the thesis: orientation, translation, and an arm with two joints."""
    return Drawings(
        "Figures 2.1 to 2.3 of the thesis, drawn anew",
        (
            (
                _orientation(),
                "Figure 2.1: orientation of a rigid body b: the axes of its frame in the inertial frame 0.",
            ),
            (_translation(), "Figure 2.2: translation of a frame: p₀ = p₁ + d₀¹, (2.7)."),
            (
                _two_joints(),
                "Figure 2.3: arm with two revolute joints: base frame, joint frames and end effector, (2.13).",
            ),
        ),
    )


def _orientation() -> str:
    canvas = _Canvas(320.0, 230.0, "Inertial frame and a rigid body with its own, rotated frame")
    canvas.shape("M150 120 C150 60 225 40 270 75 C315 110 300 180 245 185 C190 190 150 165 150 120 Z")
    canvas.frame(np.array([70.0, 180.0]), np.eye(3), "0")
    canvas.text(np.array([58.0, 196.0]), "0_0")
    canvas.frame(np.array([225.0, 120.0]), _turn((0.6, -0.5, 0.5)), "b")
    canvas.text(np.array([216.0, 137.0]), "0_b")
    return canvas.svg()


def _translation() -> str:
    canvas = _Canvas(
        320.0, 230.0, "Two parallel frames, the vector between their origins, and a point seen from both"
    )
    base, moved, point = np.array([70.0, 180.0]), np.array([190.0, 130.0]), np.array([265.0, 50.0])
    canvas.frame(base, np.eye(3), "0")
    canvas.frame(moved, np.eye(3), "1")
    for a, b, name, aside in (
        (base, moved, "d_0^1", (0.0, 18.0)), (base, point, "p_0", (-14.0, -6.0)), (moved, point, "p_1", (14.0, 6.0))
    ):  # fmt: skip
        canvas.arrow(a, b, "var(--soft)")
        canvas.text(0.55 * a + 0.45 * b + np.array(aside), name, "var(--soft)")
    canvas.parts.append(f'<circle cx="{point[0]}" cy="{point[1]}" r="3.5" fill="var(--ink)"/>')
    canvas.text(point + np.array([12.0, -4.0]), "p")
    return canvas.svg()


def _two_joints() -> str:
    """SVG of a planar arm with two joints: x and y are in the plane of the picture, z points to the viewer."""
    canvas = _Canvas(
        320.0, 230.0, "Arm with base, two revolute joints q1 and q2, and end effector, each with a frame"
    )
    angles, lengths = np.cumsum([0.9, -0.75]), (115.0, 105.0)
    places = [np.array([70.0, 190.0])]
    for angle, length in zip(angles, lengths, strict=True):
        places.append(places[-1] + length * np.array([np.cos(angle), -np.sin(angle)]))
    canvas.shape("M40 212 h60 v-10 h-60 Z")
    for a, b in pairwise(places):
        canvas.line(a, b, "var(--body-2)", 9.0)
    for place in places[:-1]:
        canvas.parts.append(
            f'<circle cx="{place[0]:.1f}" cy="{place[1]:.1f}" r="8" fill="var(--paper)" stroke="var(--blue)" '
            'stroke-width="2"/>'
        )
    frames = [
        (places[0], 0.0, "0"),
        (places[0], angles[0], "1"),
        (places[1], angles[1], "2"),
        (places[2], angles[1], "e"),
    ]
    for place, angle, index in frames:
        for axis, turn in (("x", 0.0), ("y", 0.5 * np.pi)):
            size = 62.0 if index == "0" else 40.0
            step = size * np.array([np.cos(angle + turn), -np.sin(angle + turn)])
            canvas.arrow(place, place + step, COLOURS[axis])
            canvas.text(place + step * (1.0 + 12.0 / size) + np.array([0.0, 4.0]), f"{axis}_{index}", COLOURS[axis])
    canvas.text(places[0] + np.array([-22.0, -2.0]), "q_1")
    canvas.text(places[1] + np.array([4.0, 26.0]), "q_2")
    return canvas.svg()


def schematic() -> Drawings:
    """Draws Figure 3.1 of the thesis: the hanging arm at q = 0 with the frames of Table 3.1."""
    thesis = published()
    R, p = make_frames(thesis).forward(np.zeros((1, len(thesis.frames))))
    scale, top, middle = 400.0, 60.0, 165.0
    canvas = _Canvas(460.0, 640.0, "Hanging KUKA LBR iiwa R820 at q = 0 with the frames of Table 3.1, and gravity")

    def place(height: float) -> Array:
        return np.array([middle, top + scale * height])  # z of the base points down, along gravity

    heights = [0.0, *p[0, :, 2].tolist(), float(p[0, -1, 2]) + FLANGE]
    canvas.line(place(0.0) - np.array([55.0, 8.0]), place(0.0) + np.array([55.0, -8.0]), "var(--body-2)", 5.0)
    for a, b in pairwise(heights):
        canvas.line(place(a), place(b), "var(--body-2)", 9.0)
    down = np.diag([1.0, -1.0, -1.0])  # the base frame hangs
    canvas.frame(place(0.0), down, "0", 44.0)
    for k, (rotation, height) in enumerate(zip(R[0], heights[1:-1], strict=True), 1):
        across = abs(float(rotation[2, 2])) < 0.5
        at = place(height)
        box = (9.0, 9.0, 9.0) if across else (7.0, 12.0, 2.0)
        canvas.parts.append(
            f'<rect x="{at[0] - box[0]:.1f}" y="{at[1] - box[1]:.1f}" width="{2 * box[0]:.1f}" '
            f'height="{2 * box[1]:.1f}" '
            f'rx="{box[2]}" fill="var(--paper)" stroke="var(--blue)" stroke-width="2"/>'
        )
        canvas.frame(at, down @ rotation, str(k), 44.0)
        canvas.text(at + np.array([-105.0, 4.0]), f"q_{k}", anchor="end")
        canvas.line(np.array([350.0, place(heights[k - 1])[1]]), np.array([350.0, at[1]]), "var(--soft)", 1.0)
        for end in (heights[k - 1], height):
            canvas.line(np.array([345.0, place(end)[1]]), np.array([355.0, place(end)[1]]), "var(--soft)", 1.0)
        words = f"d_{k} = {thesis.lengths[k - 1]:.4f} m"
        canvas.text(np.array([362.0, 0.5 * (place(heights[k - 1])[1] + at[1]) + 4.0]), words, "var(--soft)", "start")
    canvas.arrow(np.array([30.0, 40.0]), np.array([30.0, 100.0]), "var(--orange)", 2.2)
    canvas.text(np.array([44.0, 75.0]), "g_0", "var(--orange)", "start")
    caption = (
        "Figure 3.1: the hanging arm at q = 0, with the frames of Table 3.1; z of each frame is the axis of its "
        "joint. A round joint turns about an axis across the arm, a narrow one about an axis along it."
    )
    return Drawings("Figure 3.1 of the thesis, drawn anew", ((canvas.svg(), caption),))


FLANGE = 0.045
"""Distance of the flange from frame 7 along its z axis [m]; the thesis does not give it."""
