"""A filter of the torque alone is named with its effect, and is not taken for friction or noise."""

from __future__ import annotations

from dataclasses import replace

import pytest

from armid.errors import Finding
from armid.measurement.processing.options import ProcessingOptions
from armid.study.config import ModelChoice, RecordingChoice, RobotChoice, Study
from armid.study.identify import Result, identify
from armid.study.plausibility import one_sided_filter
from labs import small_recording, write_arm

CUTOFF = 1.0
"""Cut-off of the filter [Hz]: the motion has its fifth harmonic at 0.6 Hz."""

FRICTION = ("rigid-body", "viscous", "coulomb")


@pytest.fixture(scope="module")
def study(tmp_path_factory: pytest.TempPathFactory) -> Study:
    arm = write_arm(tmp_path_factory.mktemp("one-sided"))
    choices = (RecordingChoice("train"), RecordingChoice("check", "validate"))
    return Study(RobotChoice(str(arm)), ModelChoice(FRICTION, {"coulomb": {"width": 0.02}}), choices)


def identified(study: Study, columns: bool, terms: tuple[str, ...] = FRICTION) -> Result:
    given = {"train": small_recording(1), "check": small_recording(2)}
    processing = ProcessingOptions(cutoff=CUTOFF, columns=columns)
    return identify(replace(study, processing=processing, model=replace(study.model, terms=terms)), given=given)


def finding_of(result: Result, code: str) -> Finding | None:
    return next((each for each in result.estimate.findings if each.code == code), None)


def test_a_filter_of_the_torque_alone_fails_and_says_what_it_does(study: Study):
    result = identified(study, columns=False)
    found = finding_of(result, one_sided_filter.CODE)
    assert found is not None and found.severity == "error" and "columns = true" in found.remedy
    assert result.validation.verdict == "fail"
    assert [check.name for check in result.validation.checks if not check.ok] == [
        f"errors in the processing ({one_sided_filter.CODE})"
    ]


def test_a_filter_on_both_sides_is_not_named(study: Study):
    result = identified(study, columns=True)
    assert finding_of(result, one_sided_filter.CODE) is None and result.validation.verdict == "pass"


def test_friction_that_hides_the_filter_still_fails(study: Study):
    """Hysteresis takes up part of the residual, so the error on held-out motion falls although the bias remains."""
    plain, hidden = (identified(study, columns=False, terms=each) for each in (FRICTION, (*FRICTION, "hysteresis")))
    error = [sum(sum(score.rms**2) for score in each.validation.recordings) for each in (plain, hidden)]
    assert error[1] < error[0]
    found = finding_of(hidden, one_sided_filter.CODE)
    assert found is not None and found.severity == "error" and hidden.validation.verdict == "fail"
