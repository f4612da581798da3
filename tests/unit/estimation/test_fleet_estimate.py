"""Fleets: elimination unit by unit equals the dense problem, intervals cover, odd units are found and no others."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from armid.errors import EstimationError
from armid.estimation.fleet.between_units import common_names
from armid.estimation.fleet.elimination import (
    eliminate,
    left_out_factors,
    merged_factor,
    own_deviations,
    solve_common,
)
from armid.estimation.fleet.fleet_data import ASSUMED_SCALE, fleet_data
from armid.estimation.fleet.fleet_estimate import estimate_fleet
from armid.estimation.fleet.layout import fleet_layout
from armid.estimation.fleet.odd_units import holm
from armid.estimation.fleet.unit_rows import unit_rows
from armid.estimation.fleet.unit_update import update_unit
from armid.information.information import JointFactors, stack, total
from fleet_rows import SCALE_SPREAD, SHARED, SPREAD, drawn_fleet

ROUNDING = 1e-9
"""Relative difference of two ways through well-conditioned triangular factors."""


def dense(rows, layout, deviation):
    """Least squares with all unknowns in one matrix: common unknowns first, then those of each unit."""
    x, m, a = len(layout.shared) + len(layout.own), layout.count, len(layout.shared)
    parts, sides = [], []
    for u, each in enumerate(rows):
        block = np.zeros((len(each) + m, x + len(rows) * m))
        own = slice(x + u * m, x + (u + 1) * m)
        block[: len(each), :a] = each[:, m:-1]
        block[: len(each), own] = each[:, :m]
        block[len(each) :, own] = np.diag(1.0 / deviation)
        block[len(each) :, :x] = -layout.mean_map / deviation[:, None]
        parts.append(block)
        sides.append(np.append(each[:, -1], np.zeros(m)))
    A = np.concatenate(parts)
    solution = np.linalg.lstsq(A, np.concatenate(sides))[0]
    return solution[:x], solution[x:].reshape(len(rows), m), np.linalg.inv(A.T @ A)


@pytest.fixture(scope="module")
def small():
    fleet = drawn_fleet(5, 1)
    first = next(iter(fleet.units.values()))
    layout = fleet_layout(first, fleet.own)
    whole = [total(each) for each in fleet.units.values()]
    values = np.mean(list(fleet.values.values()), axis=0)
    rows = [unit_rows(each, layout, np.ones(2), values, np.ones(2)) for each in whole]
    return layout, rows, np.linspace(0.1, 0.5, layout.count)


def test_elimination_equals_the_dense_problem(small):
    layout, rows, deviation = small
    common, own, covariance = dense(rows, layout, deviation)
    units = [eliminate(each, layout, deviation) for each in rows]
    found = solve_common(merged_factor([unit.factor for unit in units]), common_names(layout))
    assert found.values == pytest.approx(common, rel=ROUNDING, abs=ROUNDING)
    x, m = len(common), layout.count
    assert found.half @ found.half.T == pytest.approx(covariance[:x, :x], rel=1e-7, abs=ROUNDING)
    for u, unit in enumerate(units):
        values, known, added = own_deviations(unit, layout, found)
        assert values == pytest.approx(own[u] - layout.mean_map @ common, rel=1e-7, abs=ROUNDING)
        change = np.zeros((m, len(covariance)))
        change[:, :x], change[:, x + u * m : x + (u + 1) * m] = -layout.mean_map, np.eye(m)
        assert known + added == pytest.approx(np.diag(change @ covariance @ change.T), rel=1e-7)


def test_leaving_out_a_unit_equals_the_merge_of_the_others(small):
    layout, rows, deviation = small
    factors = [eliminate(each, layout, deviation).factor for each in rows]
    for u, left in enumerate(left_out_factors(factors)):
        others = merged_factor(factors[:u] + factors[u + 1 :])
        names = common_names(layout)
        assert solve_common(left, names).values == pytest.approx(solve_common(others, names).values, rel=1e-8)


def test_order_of_units_has_no_effect():
    fleet = drawn_fleet(6, 2)
    one = estimate_fleet(fleet.units, fleet.own).estimate
    turned = estimate_fleet(dict(reversed(fleet.units.items())), fleet.own).estimate
    assert turned.units == tuple(reversed(one.units))
    assert np.array_equal(turned.values[::-1], one.values)
    assert np.array_equal(turned.prior.covariance, one.prior.covariance)


def test_scatter_between_units_is_recovered():
    fleet = drawn_fleet(60, 3, noise=0.2)
    found = estimate_fleet(fleet.units, fleet.own).estimate
    mean = np.mean(list(fleet.values.values()), axis=0)[fleet.own]
    relative = found.own.deviation[: len(mean)] / np.abs(mean)
    # Four standard errors of a standard deviation from 60 units, 9 % each.
    assert relative == pytest.approx(np.full(len(mean), SPREAD), rel=0.36)
    assert found.own.deviation[len(mean) :] == pytest.approx(np.full(2, SCALE_SPREAD), rel=0.36)


def test_intervals_of_own_parameters_cover():
    inside = []
    for seed in range(8):
        fleet = drawn_fleet(12, 100 + seed)
        found = estimate_fleet(fleet.units, fleet.own).estimate
        true = np.array([fleet.values[name] for name in found.units])
        inside.append((np.abs(found.values - true) <= 1.96 * found.deviation)[:, fleet.own])
    # Errors in one fleet are correlated by the common scale, so eight fleets are about 100 independent cases.
    assert 0.89 <= np.mean(inside) <= 0.99


def test_odd_unit_is_named_with_its_joint():
    fleet = drawn_fleet(20, 14, odd=(7, "FV_2", 3.0))
    found = estimate_fleet(fleet.units, fleet.own).estimate
    assert [(each.unit, each.parameter, each.joint) for each in found.odd] == [("u07", "FV_2", 1)]
    assert found.odd_bodies == ()


def test_two_odd_units_do_not_hide_each_other():
    fleet = drawn_fleet(20, 5, odd=(3, "FS_1", 3.0))
    other = drawn_fleet(20, 5, odd=(11, "FS_1", 3.0))
    fleet.units["u11"] = other.units["u11"]
    found = estimate_fleet(fleet.units, fleet.own).estimate
    assert {(each.unit, each.parameter) for each in found.odd} == {("u03", "FS_1"), ("u11", "FS_1")}


def test_unit_with_other_bodies_is_named():
    fleet = drawn_fleet(10, 6, odd_body=(4, 3, 1.5))
    found = estimate_fleet(fleet.units, fleet.own)
    assert [each.unit for each in found.estimate.odd_bodies] == ["u04"]
    usual = fleet.values["u00"][3]
    assert found.estimate.prior.mean[3] == pytest.approx(
        usual, abs=4.0 * np.sqrt(found.estimate.prior.covariance[3, 3])
    )


def test_fleet_without_odd_units_names_none():
    for seed in range(6):
        fleet = drawn_fleet(12, 200 + seed)
        found = estimate_fleet(fleet.units, fleet.own).estimate
        assert found.odd == () and found.odd_bodies == ()


def test_fleet_makes_a_brief_unit_known():
    fleet = drawn_fleet(20, 7)
    found = estimate_fleet(fleet.units, fleet.own)
    new = drawn_fleet(21, 7, rows=10, blocks=2)  # 20 rows of a joint for 9 parameters and a scale
    unit = update_unit(found.estimate.prior, new.units["u20"], found.layout)
    error = unit.values - new.values["u20"]
    whole = total(new.units["u20"])
    alone = np.linalg.lstsq(*stack(whole))[0] - new.values["u20"]
    # The bodies come from 20 units with eight times the rows each.
    assert np.linalg.norm(error[:SHARED]) < 0.2 * np.linalg.norm(alone[:SHARED])
    assert np.linalg.norm(error) < np.linalg.norm(alone)


def test_one_unit_is_refused():
    fleet = drawn_fleet(1, 8)
    with pytest.raises(EstimationError, match="at least two units"):
        estimate_fleet(fleet.units, fleet.own)


def test_undetermined_common_parameters_are_named():
    fleet = drawn_fleet(3, 9)
    for name, each in fleet.units.items():
        joint = each.joints[0]
        R = joint.R.copy()
        R[:, :, 0] = 0.0  # the first shared parameter acts on joint 1 alone
        fleet.units[name] = replace(each, joints=(JointFactors(joint.parameters, R), *each.joints[1:]))
    with pytest.raises(EstimationError, match="M_1"):
        estimate_fleet(fleet.units, fleet.own)


def test_holm_multiplies_by_the_number_of_remaining_comparisons():
    assert holm(np.array([0.01, 0.5, 0.02, 0.03])) == pytest.approx([0.04, 0.5, 0.06, 0.06])


def test_stated_deviation_of_gains_replaces_the_usual_one():
    fleet = drawn_fleet(3, 10)
    stated = {name: replace(each, scale_deviation=np.array([0.1, 0.0])) for name, each in fleet.units.items()}
    units, squares = fleet_data(stated, fleet.own).assumed
    assert (squares[-2:] / units[-2:]) ** 0.5 == pytest.approx([0.1, ASSUMED_SCALE])
    assert not units[:-2].any()


def test_odd_unit_does_not_hide_itself_among_few():
    fleet = drawn_fleet(5, 4, odd=(1, "FV_2", 4.0))
    found = estimate_fleet(fleet.units, fleet.own).estimate
    k = found.own.names.index("FV_2")
    true = np.array([values[fleet.own][k] for values in fleet.values.values()])
    others = np.delete(true, 1)
    student = (true[1] - others.mean()) / (others.std(ddof=1) * np.sqrt(1.0 + 1.0 / len(others)))
    # Noise and the common scale of torques change the score by less than a third.
    assert found.score[1, k] == pytest.approx(student, rel=0.33)
    assert [(each.unit, each.parameter) for each in found.odd] == [("u01", "FV_2")]
