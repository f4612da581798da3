"""Bodies of links: what follows from the parameters, and where an interval is knowledge."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from armid.checked_array import Array
from armid.dataclass_files import load, save
from armid.estimation.estimate_record import Estimate
from armid.estimation.link_properties import ENTERING, QUANTITIES, LinkTable, link_record, link_table
from armid.maths.inertia import about_com, about_com_slope
from cranes import CRANE, estimate, model, problem
from labs import URDF
from trees import random_inertial

KNOWN = (0, 1, 2)
"""Mass of the trolley and its centre in the plane."""

DRAWS = 40

COVERED = 0.90
"""Share of 120 intervals that depend on each other in groups of three: less two binomial deviations of some sixty."""


def table(text: str = CRANE, *, bodies: bool = True, seed: int = 0) -> LinkTable:
    return link_table(model(text), estimate(problem(text, seed), bodies=bodies))


@pytest.mark.witness
@pytest.mark.parametrize("seed", range(5))
def test_a_body_is_what_pinocchio_makes_of_the_same_parameters(seed: int):
    import pinocchio as pin

    vector = random_inertial(np.random.default_rng(seed), 1)[0]
    # Pinocchio's order of the six entries is the same: xx, xy, yy, xz, yz, zz.
    body = pin.Inertia.FromDynamicParameters(vector)
    inertia = body.inertia[[0, 0, 1, 0, 1, 2], [0, 1, 1, 2, 2, 2]]
    np.testing.assert_allclose(about_com(vector), [body.mass, *body.lever, *inertia], rtol=1e-12, atol=1e-13)


def test_the_slope_is_that_of_differences_and_says_what_enters():
    vector = random_inertial(np.random.default_rng(7), 1)[0]
    step = 1e-6
    differences = [about_com(vector + step * e) - about_com(vector - step * e) for e in np.eye(10)]
    slope = about_com_slope(vector)
    np.testing.assert_allclose(slope, np.array(differences).T / (2 * step), atol=1e-8)
    assert np.array_equal(slope != 0.0, ENTERING)


def test_a_body_without_a_mass_has_no_centre():
    assert np.isnan(about_com(np.zeros(10))[1:]).all()


def test_what_slides_and_turns_is_known_with_intervals_that_hold_the_truth():
    held: list[Array] = []
    for seed in range(DRAWS):
        last = table(seed=seed).links[-1]
        ends = last.intervals[list(KNOWN)]
        assert np.isfinite(ends).all() and not any(last.reasons[k] for k in KNOWN)
        truth = last.description[list(KNOWN)]
        held.append((ends[:, 0] <= truth) & (truth <= ends[:, 1]))
        assert np.abs(last.estimate[0] - 2.0) < 0.2
    assert np.mean(held) > COVERED


def test_what_no_force_shows_has_no_interval_but_the_reason():
    first, last = table().links
    assert (first.link, first.joint, last.link, last.joint) == ("tower", "turn", "trolley", "slide")
    unknown = [k for k in range(10) if k not in KNOWN]
    assert np.isnan(last.intervals[unknown]).all() and all(last.reasons[k] for k in unknown)
    assert last.reasons[3] == "MZ_2 not identifiable"
    assert np.isnan(first.intervals).all()


def test_intervals_of_centre_and_inertia_follow_the_covariance():
    data = problem()
    found = estimate(data)
    fit = found.fit.standard
    assert fit is not None
    rng = np.random.default_rng(3)
    theta, factor = random_inertial(rng, 1)[0], 1e-4 * rng.normal(size=(10, 10))
    p, own = len(fit.names), model().inertial_columns.reshape(-1, 10)[1]
    values, covariance = fit.values.copy(), np.zeros((p, p))
    values[own], covariance[np.ix_(own, own)] = theta, factor @ factor.T
    half = 2.5 * np.sqrt(np.diag(covariance))
    ends = np.stack([values - half, values + half], axis=1)
    fit = replace(fit, values=values, covariance=covariance, intervals=ends, status=("identified",) * p)
    body = link_table(model(), replace(found, fit=replace(found.fit, standard=fit))).links[1]
    drawn = np.array([about_com(theta + factor @ rng.normal(size=10)) for _ in range(4000)])
    # A deviation from so many draws is known to 1.1 %; the smaller deviations are the closer the slope is.
    np.testing.assert_allclose(0.5 * np.ptp(body.intervals, axis=1), 2.5 * drawn.std(axis=0), rtol=0.05)
    np.testing.assert_allclose(body.intervals.mean(axis=1), about_com(theta), rtol=1e-9)


def test_turning_joints_leave_open_how_links_share_their_mass():
    for body in table(URDF).links:
        assert np.isnan(body.intervals[0]).all() and body.reasons[0].startswith("M_")
        assert np.isfinite(body.estimate).all()
    np.testing.assert_allclose(
        table(URDF).links[0].description, [3, 0.02, 0, 0.15, 0.05, 0.001, 0.04, 0, 0.002, 0.03]
    )


def test_base_parameters_give_no_bodies_and_the_table_says_what_does():
    plain = table(bodies=False)
    assert plain.method == "wls" and "--method physical" in plain.note
    assert all(np.isnan(body.estimate).all() and np.isfinite(body.description).all() for body in plain.links)
    assert table().note == ""


def test_the_record_has_null_for_what_is_not_known():
    record = link_record(table())[-1]
    assert record["link"] == "trolley" and set(record["reasons"]) == set(QUANTITIES)
    assert np.isnan(record["interval95"]["com"][2]).all() and np.isfinite(record["interval95"]["mass"]).all()


def test_the_covariance_of_standard_parameters_is_kept(tmp_path: Path):
    found = estimate(problem())
    again = load(Estimate, save(found, tmp_path / "estimate.npz")).fit.standard
    assert again is not None and found.fit.standard is not None
    np.testing.assert_array_equal(again.covariance, found.fit.standard.covariance)
    np.testing.assert_allclose(again.deviation**2, np.diag(again.covariance))
