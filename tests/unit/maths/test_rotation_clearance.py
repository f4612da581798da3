"""Profiles of bodies that turn about an axis, against points of their triangles at many angles."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from armid.maths.rotation_clearance import swept_profile

ROUNDING = 1e-12


def on_triangles(rng, triangles):
    """Random points of each triangle, shape (t * 20, 3)."""
    share = rng.dirichlet(np.ones(3), (len(triangles), 20))
    return np.einsum("tsk,tkx->tsx", share, triangles).reshape(-1, 3)


@pytest.mark.parametrize("seed", range(20))
def test_profiles_enclose_the_points_of_their_triangles(seed):
    rng = np.random.default_rng(seed)
    axis, origin = Rotation.random(random_state=seed).as_matrix()[0], rng.normal(size=3)
    triangles = origin + rng.normal(size=(40, 1, 3)) + rng.uniform(0.1, 2.0) * rng.normal(size=(40, 3, 3))
    profile = swept_profile(triangles, axis, origin)
    points = on_triangles(rng, triangles).reshape(40, 20, 3) - origin
    height = points @ axis
    radius = np.linalg.norm(points - height[..., None] * axis, axis=2)
    for found, (low, high) in ((radius, profile.radius.T), (height, profile.height.T)):
        assert (found >= low[:, None] - ROUNDING).all() and (found <= high[:, None] + ROUNDING).all()


@pytest.mark.parametrize("seed", range(20))
def test_bodies_whose_profiles_are_apart_are_apart_at_all_angles(seed):
    rng = np.random.default_rng(seed)
    axis, origin = Rotation.random(random_state=seed).as_matrix()[0], rng.normal(size=3)
    still, moving = (origin + rng.normal(size=3) + 0.2 * rng.normal(size=(30, 3, 3)) for _ in range(2))
    one, other = swept_profile(still, axis, origin), swept_profile(moving, axis, origin)
    points, others = on_triangles(rng, still) - origin, on_triangles(rng, moving) - origin
    nearest = min(
        np.linalg.norm(points[:, None] - turned[None], axis=2).min()
        for angle in np.linspace(-np.pi, np.pi, 36)
        for turned in [Rotation.from_rotvec(angle * axis).apply(others)]
    )
    distances = np.geomspace(1e-3, 3.0, 40)
    apart = [d for d in distances if not one.closer_than(other, d)]
    assert max(apart, default=0.0) <= nearest + ROUNDING
    assert [other.closer_than(one, d) for d in distances] == [one.closer_than(other, d) for d in distances]
