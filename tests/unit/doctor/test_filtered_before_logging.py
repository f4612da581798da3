"""Torque that was filtered before logging is named, with its cut-off and a severity that follows its harm."""

from __future__ import annotations

import numpy as np
import pytest
from support import sick

from armid.errors import Finding
from armid.maths.signals.zero_phase_filters import butterworth, zero_phase
from armid.measurement.processing.options import ProcessingOptions
from armid.study.diagnosis import diagnose_recording

SEEDS = (3, 8)
"""Sound logs of two arms; their motion has frequencies up to 0.6 Hz."""


def logged(seed: int, cutoff: float | None, decimals: int) -> sick.Case:
    """A log whose torque was filtered at a cut-off [Hz] and then written with some decimals."""
    case = sick.sound(seed)
    effort = case.recording.effort
    assert effort is not None
    rate = 1.0 / float(case.motion.time[1])
    if cutoff is not None:
        effort = zero_phase(butterworth(2, cutoff, rate), effort)
    return case.logged(effort=np.round(effort, decimals))


def told(case: sick.Case, used: float = 5.0) -> list[Finding]:
    options = ProcessingOptions(cutoff=used)
    found = diagnose_recording(case.robot, case.recording, case.reading, processing=options)
    return [each for each in found if each.code == "filtered-before-logging"]


@pytest.mark.parametrize("decimals", [3, 6, 9])
@pytest.mark.parametrize(("cutoff", "severity"), [(1.0, "error"), (3.0, "warning")])
@pytest.mark.parametrize("seed", SEEDS)
def test_a_filter_is_named_whatever_the_decimals(seed: int, cutoff: float, severity: str, decimals: int):
    (found,) = told(logged(seed, cutoff, decimals))
    assert found.severity == severity
    half = float(found.evidence.split(" at ")[1].split(" Hz")[0])
    # The window spreads each line of the spectrum over half a hertz. Friction that is fitted to a filtered torque is
    # too small by up to a half, and the torque falls that much over a quarter of the cut-off.
    assert half == pytest.approx(cutoff, rel=0.25, abs=0.7)


@pytest.mark.parametrize("decimals", [3, 6, 9])
@pytest.mark.parametrize("seed", SEEDS)
def test_a_filter_far_above_the_band_needs_no_action(seed: int, decimals: int):
    assert {each.severity for each in told(logged(seed, 12.0, decimals))} <= {"info"}


@pytest.mark.parametrize("seed", SEEDS)
def test_a_narrower_band_makes_it_harmless(seed: int):
    case = logged(seed, 5.0, 6)
    (found,) = told(case)
    assert found.severity == "warning"
    (after,) = told(case, found.remedy.keys["cutoff"])
    assert after.severity == "info"


@pytest.mark.parametrize("decimals", [1, 2, 3])
@pytest.mark.parametrize("seed", SEEDS)
def test_coarse_resolution_alone_is_no_filter(seed: int, decimals: int):
    case = sick.sound(seed)
    exact = case.logged(effort=np.round(case.torque, decimals))  # no noise other than the rounding
    assert {each.severity for each in told(exact)} <= {"info"}  # smooth friction in steps of rounding has no floor
    assert not told(logged(seed, None, decimals))


@pytest.mark.parametrize("seed", SEEDS)
def test_a_filter_of_one_torque_is_named_with_its_joint(seed: int):
    case = sick.sound(seed)
    assert case.recording.effort is not None
    effort = case.recording.effort.copy()
    effort[:, 1] = zero_phase(butterworth(2, 1.0, 1.0 / float(case.motion.time[1])), effort[:, 1:2])[:, 0]
    found = told(case.logged(effort=effort))
    assert [(each.channel, each.severity) for each in found] == [(case.robot.joint_names[1], "error")]
