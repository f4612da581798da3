"""Worth of the thesis's published parameters: no real body has those of Table 4.1 or of Table 4.2."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from armid import load_robot
from armid.runs.consistency_check import Verdict, certify_named, read_plan

TRUTH = json.loads((Path(__file__).parent / "data" / "truth.json").read_text())
PHYSICAL = ("m", "rx", "ry", "rz", "Ixx", "Ixy", "Ixz", "Iyy", "Iyz", "Izz", "Fv", "Fs")
HANGING = (0.0, 0.0, 9.81)

# Two independent programs, with other solvers and another smallest eigenvalue, differ by 2e-4.
DISTANCE = pytest.approx(1.082, abs=3e-3)


@pytest.fixture(scope="module")
def table41() -> Verdict:
    values = {name: value for name, (value, _) in TRUTH["table41"].items()}
    robot = load_robot("iiwa14-r820", gravity=HANGING)
    return certify_named(robot, values, motion=read_plan("thesis-a2"))


@pytest.fixture(scope="module")
def table42() -> Verdict:
    rows = enumerate(TRUTH["table42_mu"])
    values = {f"{name}_{k + 1}": x for k, row in rows for name, x in zip(PHYSICAL, row, strict=True)}
    return certify_named(load_robot("iiwa14-r820", gravity=HANGING), values)


def test_table_41_belongs_to_no_real_body(table41: Verdict):
    certificate = table41.certificate
    assert not certificate.feasible
    assert certificate.distance == DISTANCE
    assert table41.limited.distance == DISTANCE
    assert certificate.distance <= table41.limited.distance
    assert certificate.relative_distance == pytest.approx(0.0205, abs=1e-4)
    assert certificate.inertial_distance == pytest.approx(0.080, abs=5e-4)
    assert certificate.masses.sum() > 1000.0  # tonnes
    assert (table41.limited.masses <= 10.0 + 1e-6).all()
    inertial = np.linalg.norm([v for n, (v, _) in TRUTH["table41"].items() if not n.startswith("F")])
    assert certificate.distance / inertial == pytest.approx(0.080, abs=5e-4)
    assert [each.name for each in certificate.blame[:4]] == ["XY_3", "ZZR_3", "ZZR_4", "XXR_4"]


def test_its_mass_matrix_is_positive_all_the_same(table41: Verdict):
    assert table41.pose.min_eigenvalue == pytest.approx(0.00977, abs=1e-5)
    assert table41.along is not None
    assert table41.along.min_eigenvalue == pytest.approx(0.01385, abs=1e-5)
    assert any(finding.code == "mass-matrix-positive" for finding in table41.findings)


def test_table_42_breaks_its_own_constraints(table42: Verdict):
    broken = {(c.constraint, c.link) for c in table42.constraints if not c.rounding}
    assert broken == {("(3.53c)", link) for link in range(1, 7)} | {("(3.52d)", 5), ("(3.52d)", 6)}
    assert not table42.certificate.feasible
    assert table42.pose.min_eigenvalue == pytest.approx(0.0181, abs=1e-4)


def test_the_description_is_a_real_body():
    robot = load_robot("iiwa14-r820")
    rows = enumerate(TRUTH["urdf_mu"])
    values = {f"{name}_{k + 1}": x for k, row in rows for name, x in zip(PHYSICAL, row, strict=True)}
    verdict = certify_named(robot, values)
    # Its last link is a point but for rounding: a dust of 1e-6 in every eigenvalue is what separates them.
    assert verdict.certificate.feasible
    broken = {(c.constraint, c.link) for c in verdict.constraints if not c.ok}
    assert ("(3.53f)", 2) in broken and ("(3.53f)", 4) in broken
