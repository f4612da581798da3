"""What a certificate says of a run: the numbers, and what they mean for who made it."""

from __future__ import annotations

from dataclasses import replace

import pytest

from armid.errors import ModelError
from armid.robot import load_robot
from armid.robot.readers.urdf import read
from armid.study.certify import Verdict, certify_named, certify_run, described_values
from armid.study.run import Run
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
    assert "ZZR_1" in said and "noise is not all of it" in said and "armid doctor" in said
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
    with pytest.raises(ModelError, match="no bodies"):
        described_values(load_robot("panda"))
