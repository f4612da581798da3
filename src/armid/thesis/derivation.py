"""Check of equations (3.9) to (3.30) of the thesis, the derivation of the dependent columns, at random states.

Velocities and rotations of the links are computed from the joint axes in the base frame, and β from the Lagrangian.
The recursion that an equation states is thus used for neither side of it. All equations are checked with the sign of
gravity that the thesis prints; they are valid for both signs.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from armid.checked_array import Array
from armid.thesis.hyperdual import constant
from armid.thesis.lagrange import lagrangian_terms, link_motion, make_frames
from armid.thesis.published import published
from armid.thesis.setting import HANGING, LITERAL, Setting, random_states

ALONG_Y, ALONG_Z = (2, 4, 6), (3, 5)
"""Indices (from 0) of links 3, 5 and 7, whose translation d_n is along y, and of links 4 and 6, whose d_n is along z
and whose d_{n-1} is along y."""


@dataclass(frozen=True, slots=True)
class Identity:
    """Equation of the derivation of dependent columns.

    Attributes:
        number: Equation number in the thesis, (3.9) to (3.30).
        printed: Equation as the thesis prints it. The name of a parameter stands for the element of β that belongs to
            that parameter.
        error: Largest difference between the two sides at random states, divided by the largest absolute value of the
            left side.
        right: Correct equation, if the printed one is wrong; otherwise empty.
        right_error: Value of `error` for the correct equation.
    """

    number: str
    printed: str
    error: float
    right: str = ""
    right_error: float = 0.0


class _Links:
    """Kinematic quantities and vectors β of all links at N random states; arrays have the shape (N, 7, ...)."""

    def __init__(self, setting: Setting) -> None:
        states, frames = random_states(setting, seed=4), make_frames(published())
        beta = lagrangian_terms(frames, constant(states.q), constant(states.dq), np.array(LITERAL)).parts[0]
        motion = link_motion(frames, states.q, states.dq)
        self.beta = dict(
            zip(("M", "MX", "MY", "MZ", "XX", "XY", "XZ", "YY", "YZ", "ZZ"), beta.T.swapaxes(1, 2), strict=True)
        )
        self.q, self.dq = states.q, states.dq
        self.velocity, self.turning, self.motion = motion.velocity, motion.turning, motion
        down = np.swapaxes(motion.rotation, -1, -2)
        self.gravity = down @ np.array(HANGING)  # R_n^0 g_0
        self.arm = np.broadcast_to(frames.translation, (states.samples, 7, 3))
        # R_n^{n-1}, and the y and z part of d
        self.turn = np.concatenate([down[:, :1], down[:, 1:] @ motion.rotation[:, :-1]], axis=1)
        self.facing = -np.array([1.0 if row[2] == "0" else -1.0 for row in published().frames])  # -cos φ_n


def derivation(setting: Setting) -> tuple[Identity, ...]:
    """Checks equations (3.9) to (3.30) of the thesis, each for all links to which it applies."""
    links = _Links(setting)
    return (*_kinematics(links), *_first_moments(links), *_masses(links))


def _error(left: Array, right: Array, which: Sequence[int] = range(7)) -> float:
    """Largest difference of two arrays (N, 7, ...) over the links `which`, relative to the largest left element."""
    at = list(which)
    return float(np.abs(left[:, at] - right[:, at]).max() / np.abs(left[:, at]).max())


def _before(x: Array, k: int = 1) -> Array:
    """Array (N, 7, ...) that contains for each link the values of the link k places before; zero for the first k."""
    return np.concatenate([np.zeros_like(x[:, :k]), x[:, :-k]], axis=1)


def _kinematics(links: _Links) -> tuple[Identity, ...]:
    """Checks equations (3.9) to (3.18) of the thesis on the kinematics of the links."""
    w, v, d = _before(links.turning), _before(links.velocity), links.arm
    s, c, own = np.sin(links.q), np.cos(links.q), np.zeros_like(w)
    own[..., 2] = links.dq
    later, sign = range(1, 7), links.facing
    zero, one = np.zeros_like(s), np.ones_like(s)
    rows = ((-sign * c, zero, s), (sign * s, zero, c), (zero, sign * one, zero))
    form = np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)
    turned = np.einsum("nkij,nkj->nki", links.turn, w)
    moved = np.einsum("nkij,nkj->nki", links.turn, v + np.cross(w, d))
    (s2, c2), (s3, c3), speed = (s[:, 1], c[:, 1]), (s[:, 2], c[:, 2]), links.dq
    second = np.stack([speed[:, 0] * s2, speed[:, 0] * c2, speed[:, 1]], axis=-1)
    x, y = speed[:, 0] * s2 * s3 + speed[:, 1] * c3, speed[:, 0] * s2 * c3 - speed[:, 1] * s3
    third = published().lengths[2] * np.stack([x, y, 0.0 * x], axis=-1)
    XX, YY, ZZ = links.beta["XX"], links.beta["YY"], links.beta["ZZ"]
    height = -HANGING[2] * sum(published().lengths[:2]) * np.ones(len(s))
    resting = np.stack([links.beta["M"][:, 1], links.beta["MZ"][:, 1]], axis=-1)
    return (
        Identity("(3.9)", "ωₙ = R ωₙ₋₁ + q̇ₙ a,  ḋₙ = R (ḋₙ₋₁ + ωₙ₋₁ × d)",
                 max(_error(links.turning, turned + own), _error(links.velocity, moved, range(2, 7)))),
        Identity("(3.10)", "ω₂ = [q̇₁ s₂, q̇₁ c₂, q̇₂],  ḋ₃ = d₃ [q̇₁ s₂ s₃ + q̇₂ c₃, q̇₁ s₂ c₃ − q̇₂ s₃, 0]",
                 max(_error(links.turning[:, 1:2], second[:, None], [0]),
                     _error(links.velocity[:, 2:3], third[:, None], [0]))),
        Identity("(3.13)", "M₂ = −g (d₁ + d₂),  MZ₂ = 0",
                 float(np.abs(resting - np.stack([height, 0.0 * height], axis=-1)).max() / np.abs(height).max())),
        Identity("(3.14), (3.17)", "Rₙ = [−e cₙ 0 sₙ; e sₙ 0 cₙ; 0 e 0],  e = −cos φₙ = ±1",
                 _error(links.turn, form, later)),
        Identity("(3.16)", "ωₙ = [−e cₙ ωₓ + sₙ ω_z, e sₙ ωₓ + cₙ ω_z, e ω_y + q̇ₙ]",
                 _error(links.turning, np.einsum("nkij,nkj->nki", form, w) + own, later)),
        Identity("(3.18)", "XXₙ + YYₙ = (XX + ZZ)ₙ₋₁", _error(XX + YY, _before(XX + ZZ), later)),
    )  # fmt: skip


def _first_moments(links: _Links) -> tuple[Identity, ...]:
    """Checks equations (3.19) to (3.23) of the thesis on the elements of β for first moments."""
    MY, MZ, XX, YZ, ZZ = (links.beta[name] for name in ("MY", "MZ", "XX", "YZ", "ZZ"))
    w, v, g, d = _before(links.turning), _before(links.velocity), _before(links.gravity), links.arm
    g[:, 0] = HANGING  # the base
    sign, later = links.facing, range(2, 7)
    inward = np.einsum("nkij,nkj->nki", links.turn, np.cross(w, v + np.cross(w, d)))
    across = np.cross(w, d)
    third = (np.cross(-w, v) - g)[..., 1] + w[..., 0] * across[..., 2] - w[..., 2] * across[..., 0]
    split = w[..., 0] * v[..., 2] - w[..., 2] * v[..., 0] - g[..., 1]
    split = split + w[..., 0] * across[..., 2] - w[..., 2] * across[..., 0]
    squares = _before(MY) + (w[..., 0] ** 2 + w[..., 2] ** 2) * d[..., 1] - w[..., 1] * w[..., 2] * d[..., 2]
    joined = _before(MY) + 2.0 * d[..., 1] * _before(XX + ZZ) - d[..., 2] * _before(YZ)
    first = sign * (np.cross(-w, v + across) - g)[..., 1]
    return (
        Identity("(3.19)", "MZₙ = (−ωₙ × ḋₙ − R g₀)_z",
                 _error(MZ, (np.cross(-links.turning, links.velocity) - links.gravity)[..., 2], later)),
        Identity("(3.20)", "MZₙ = (−R (ωₙ₋₁ × (ḋₙ₋₁ + ωₙ₋₁ × d)) − R Rₙ₋₁ g₀)_z",
                 _error(MZ, (-inward - np.einsum("nkij,nkj->nki", links.turn, g))[..., 2], later)),
        Identity("(3.21)", "(R v)_z = −cos φₙ v_y",
                 _error(np.einsum("nkij,nkj->nki", links.turn, v)[..., 2], sign * v[..., 1], range(3, 7))),
        Identity("(3.22)", "MZₙ = −cos φₙ (…)_y, its three lines",
                 max(_error(MZ, x, later) for x in (first, sign * split, sign * third))),
        Identity("(3.23), squares", "MZₙ = −cos φₙ (MYₙ₋₁ + (ωₓ² + ω_z²) d_y − ω_y ω_z d_z)",
                 _error(MZ, sign * squares, later)),
        Identity("(3.23)", "MZₙ = −cos φₙ (MY + 2 d_y (XX + ZZ) − d_z YZ)ₙ₋₁", _error(MZ, sign * joined, later)),
    )  # fmt: skip


def _masses(links: _Links) -> tuple[Identity, ...]:
    """Checks equations (3.24) to (3.30) of the thesis on the elements of β for masses."""
    M, MY, MZ, XX, YY, ZZ = (links.beta[name] for name in ("M", "MY", "MZ", "XX", "YY", "ZZ"))
    w, v, g, arm, d = (
        _before(links.turning),
        _before(links.velocity),
        _before(links.gravity),
        links.arm,
        published().lengths,
    )
    height = _before(links.motion.origin) @ np.array(HANGING)
    speed = np.einsum("nkij,nkj->nki", links.turn, v + np.cross(w, arm))
    general = 0.5 * np.sum(speed**2, axis=-1) - height - np.sum(g * arm, axis=-1)
    parts = -v[..., 0] * w[..., 2] + v[..., 2] * w[..., 0] - g[..., 1]
    along = 0.5 * np.sum(v**2, axis=-1) - height + d * parts + 0.5 * d**2 * (w[..., 0] ** 2 + w[..., 2] ** 2)
    long, last = d + np.roll(d, 1), np.roll(d, 1)
    stem = _before(M, 2) + last * _before(MY, 2) + last**2 * _before(XX + ZZ, 2)
    step = stem + d * (_before(MY, 2) + 2.0 * last * _before(XX + ZZ, 2))
    head = "Mₙ = Mₙ₋₂ + dₙ₋₁ MYₙ₋₂ + dₙ₋₁² (XX + ZZ)ₙ₋₂ + dₙ (MYₙ₋₂ + 2 dₙ₋₁ (XX + ZZ)ₙ₋₂) + dₙ²"
    return (
        Identity("(3.24)", "Mₙ = |R (ḋₙ₋₁ + ωₙ₋₁ × d)|² / 2 − g₀ᵀ (dₙ₋₁ + R d)", _error(M, general, range(2, 7))),
        Identity("(3.25)",
                 "Mₙ = |ḋ|² / 2 − g₀ᵀ d + dₙ (−ḋₓ ω_z + ḋ_z ωₓ − (g₀ᵀ R)_y) + dₙ² (ωₓ² + ω_z²) / 2, of n − 1",
                 _error(M, along, ALONG_Y)),
        Identity("(3.26)", "Mₙ = (M + dₙ MY + dₙ² (XX + ZZ))ₙ₋₁",
                 _error(M, _before(M) + d * _before(MY) + d**2 * _before(XX + ZZ), ALONG_Y)),
        Identity("(3.27)", "Mₙ = (M + dₙ MZ + dₙ² (XX + YY))ₙ₋₁",
                 _error(M, _before(M) + d * _before(MZ) + d**2 * _before(XX + YY), (1, *ALONG_Z))),
        Identity("(3.29)", f"{head} (XX + YY)ₙ₋₂", _error(M, step + d**2 * _before(XX + YY, 2), ALONG_Z),
                 f"{head} (XX + ZZ)ₙ₋₂", _error(M, step + d**2 * _before(XX + ZZ, 2), ALONG_Z)),
        Identity("(3.30)", "Mₙ = Mₙ₋₂ + (dₙ₋₁ + dₙ) MYₙ₋₂ + (dₙ₋₁ + dₙ)² (XX + ZZ)ₙ₋₂",
                 _error(M, _before(M, 2) + long * _before(MY, 2) + long**2 * _before(XX + ZZ, 2), ALONG_Z)),
    )  # fmt: skip
