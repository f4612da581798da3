"""Certificate of a run: the numbers, and what they mean for who made it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from armid.cli.commands.certify_parameters import _report
from armid.errors import EstimationError, ModelError
from armid.robot import load_robot
from armid.robot.readers.urdf import read
from armid.runs.consistency_check import (
    HEAVIER,
    HEAVIEST,
    PHYSICAL,
    Verdict,
    certify_named,
    certify_run,
    described_values,
    usual_heaviest,
    verdict_record,
)
from armid.runs.run import Run
from labs import URDF
from reports import make_run


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Run:
    return make_run(tmp_path_factory.mktemp("run"))


def meaning(verdict: Verdict) -> str:
    return " ".join(f"{each.evidence} {each.remedy}" for each in verdict.findings if each.code == "what-it-means")


def shifted(run: Run, step: float) -> Run:
    """The run with so much taken off an inertia, more than a body can spare."""
    fit = run.estimate.fit
    k = fit.names.index("ZZR_1")
    values = fit.values.copy()
    values[k] -= step
    return replace(run, estimate=replace(run.estimate, fit=replace(fit, values=values)))


def test_noise_is_told_from_what_noise_cannot_do(run: Run):
    """An inertia below zero by far more than its interval: no noise, and the method is named that keeps to bodies."""
    size = abs(run.estimate.fit.values[run.estimate.fit.names.index("ZZR_1")])
    verdict = certify_run(shifted(run, 3.0 * size + 1.0))
    assert not verdict.certificate.feasible
    said = meaning(verdict)
    assert "ZZR_1" in said and "noise is not the only cause" in said and "armid doctor" in said
    assert "--method physical" in said


def test_wide_intervals_are_noise_enough(run: Run):
    size = abs(run.estimate.fit.values[run.estimate.fit.names.index("ZZR_1")])
    wrong = shifted(run, 3.0 * size + 1.0)
    fit = wrong.estimate.fit
    wide = replace(fit, covariance=1e6 * fit.covariance + 1e6 * size**2)
    said = meaning(certify_run(replace(wrong, estimate=replace(wrong.estimate, fit=wide))))
    assert "within the 95 % intervals" in said and "armid doctor" not in said


def test_a_description_is_certified_by_its_own_bodies():
    robot = read(URDF, source="small", locked={}, tip=None)
    values = described_values(robot)
    assert certify_named(robot, values).certificate.feasible
    thin = values | {"XX_3": values["YY_3"] + values["ZZ_3"] + 1.0}  # a moment greater than the two others together
    verdict = certify_named(robot, thin)
    assert not verdict.certificate.feasible and verdict.certificate.distance > 0.0


def test_a_description_without_bodies_has_nothing_to_certify():
    with pytest.raises(ModelError, match="no masses and inertias"):
        described_values(load_robot("panda"))


def test_names_that_are_not_complete_are_told_in_their_own_kind():
    """Base, standard and physical names differ; what is missing is missing of the set that was begun."""
    robot = read(URDF, source="small", locked={}, tip=None)
    values = described_values(robot)
    del values["XX_3"]
    with pytest.raises(ModelError, match="30 standard parameters of small: XX_3 missing"):
        certify_named(robot, values)
    with pytest.raises(ModelError, match="Unknown names: QQ_1") as caught:
        certify_named(robot, {"QQ_1": 1.0})
    assert all(each in str(caught.value) for each in ("ZZR_1", "M_1, MX_1", "m_1, rx_1"))


def test_a_run_of_bodies_says_what_its_own_weigh(tmp_path: Path):
    """Its base parameters belong to many bodies; the nearest ones are others than the run's."""
    own = make_run(tmp_path, method="physical")
    standard = own.estimate.fit.standard
    assert standard is not None
    said = {each.code: each.evidence for each in certify_run(own).findings}["own-bodies"]
    assert f"{standard.values[standard.names.index('M_2')]:.4g}" in said
    assert f"{standard.proof.smallest_eigenvalue:.3g}" in said


@pytest.mark.parametrize("heaviest", [0.0, 1e-9, 1e-6])
def test_a_limit_that_leaves_no_body_is_refused(heaviest: float):
    """A real body's pseudo-inertia has a least eigenvalue, and so its mass; under it a search has nothing to find."""
    robot = read(URDF, source="small", locked={}, tip=None)
    with pytest.raises(EstimationError, match="The largest allowed mass of a link"):
        certify_named(robot, described_values(robot), heaviest=heaviest)


GANTRY = """<robot name="gantry"><link name="base"/>
<joint name="x" type="prismatic"><parent link="base"/><child link="bridge"/><axis xyz="1 0 0"/>
<limit lower="0" upper="2" velocity="1" effort="500"/></joint>
<link name="bridge"><inertial><mass value="40"/>
<inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial></link>
<joint name="y" type="KIND"><parent link="bridge"/><child link="trolley"/><axis xyz="0 1 0"/>
<limit lower="0" upper="1" velocity="1" effort="100"/></joint>
<link name="trolley"><inertial><mass value="8"/><origin xyz="0.1 0 0"/>
<inertia ixx="0.1" ixy="0" ixz="0" iyy="0.1" iyz="0" izz="0.1"/></inertial></link></robot>"""


@pytest.mark.parametrize(("kind", "unit"), [("prismatic", "kg"), ("revolute", "kg·m² or kg, SI units of the joints")])
def test_a_heavy_gantry_has_its_own_units_and_masses(tmp_path: Path, kind: str, unit: str, capsys):
    """The limit of ten kilograms is that of an arm; a bridge of forty lies far from every body under it."""
    path = tmp_path / "gantry.urdf"
    path.write_text(GANTRY.replace("KIND", kind))
    robot = load_robot(path)
    verdict = certify_named(robot, described_values(robot))
    assert verdict.heaviest == 100.0 and verdict.limited.distance < 1e-6
    assert verdict.pose.unit == unit and verdict_record(verdict)["mass_matrix"]["unit"] == unit
    _report(verdict, None)
    out = " ".join(capsys.readouterr().out.split())
    assert "with no link above 100 kg (--heaviest; default: 2.5 times the heaviest link of the description" in out
    assert f"{verdict.pose.min_eigenvalue:.5g} {unit} at q" in out
    if kind == "prismatic":
        assert verdict.pose.min_eigenvalue == pytest.approx(8.0)
    assert certify_named(robot, described_values(robot), heaviest=10.0).limited.distance > 1.0


def test_the_limit_follows_the_heaviest_link_of_the_description(run: Run):
    """An arm of 3 kg has no link of 10 kg; the limit scales with the described masses."""
    described = max(link.inertial.mass for link in run.robot.links if link.inertial is not None)
    assert certify_run(run).heaviest == HEAVIER * described and certify_run(run).pose.unit == "kg·m²"


def test_links_without_mass_may_be_heavier_than_those_with_one(run: Run):
    """A description with the mass of its last link alone, or placeholders for the others, knows no heaviest link."""
    robot = run.robot
    *others, last = (link for link in robot.links)
    assert last.inertial is not None
    for mass in (None, 0.0, 1e-6):
        unknown = None if mass is None else replace(last.inertial, mass=mass)
        links = (*(replace(link, inertial=unknown) for link in others), last)
        assert usual_heaviest(replace(robot, links=links)) == HEAVIEST
    heavy = replace(last, inertial=replace(last.inertial, mass=40.0))
    partly = (*(replace(link, inertial=None) for link in others), heavy)
    assert usual_heaviest(replace(robot, links=partly)) == HEAVIER * 40.0


def test_rounding_to_three_decimals_explains_only_values_with_three_decimals():
    """A mass of four decimals shows that the others are exact, so a product above its bound is above it."""
    robot = read(URDF, source="small", locked={}, tip=None)
    values = {f"{symbol}_{k}": 0.0 for k in range(1, robot.n + 1) for symbol in PHYSICAL}
    values |= {name: 0.009 for name in values if name.split("_")[0] in ("m", "Ixx", "Iyy", "Izz")}

    def product(**changed: float) -> tuple[bool, bool]:
        found = certify_named(robot, values | changed).constraints
        return next((each.ok, each.rounding) for each in found if (each.constraint, each.link) == ("(3.53c)", 1))

    assert product(Ixy_1=0.001) == (False, True)
    assert product(Ixy_1=0.001, m_1=0.0101) == (False, False)
    assert product() == (True, True)
