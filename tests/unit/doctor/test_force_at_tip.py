"""A force on the last link that changes at any time is found by the torques of all joints together."""

from __future__ import annotations

import numpy as np
import pytest

from armid.checked_array import Array
from armid.doctor.residuals import force_at_tip
from armid.maths.signals.zero_phase_filters import butterworth, zero_phase
from armid.study.diagnosis import diagnose_recording
from sick import Case, felt_at_tip, sound

CODE = "contact"

FORCE = 15.0
"""RMS of each component of the force [N]."""

TOLERANCE = 0.35
"""Relative error of the RMS force: its constant part is attributed to the weight of the links."""

NAMES = ("ur10e", "iiwa14-r820")


def wandering(case: Case) -> Array:
    """Force (N, 3) that wanders below 0.3 Hz [N]."""
    time = case.motion.time
    noise = np.random.default_rng(5).standard_normal((len(time), 3))
    slow = zero_phase(butterworth(2, 0.3, 1.0 / float(np.median(np.diff(time)))), noise)
    return FORCE * slow / slow.std(axis=0)


def felt(case: Case, force: Array) -> Array:
    """Torques (N, n) of a force (N, 3) at the tip [N·m]."""
    each = [felt_at_tip(case.robot, case.motion.q, axis) * force[:, [k]] for k, axis in enumerate(np.eye(3))]
    return np.sum(each, axis=0)


def pulled(case: Case, force: Array) -> Case:
    """The log of an arm whose tip feels a force (N, 3) [N]."""
    assert case.recording.effort is not None
    return case.logged(effort=case.recording.effort + felt(case, force))


@pytest.mark.parametrize("name", NAMES)
def test_a_hand_that_holds_the_tip_is_named(name: str):
    case = sound(11, name=name)
    force = wandering(case)
    case = pulled(case, force)
    found = diagnose_recording(case.robot, case.recording, case.reading)
    assert not [f for f in found if f.severity == "error"]
    (contact,) = (f for f in found if f.code == CODE)
    size = float(contact.evidence.split("lacks: ")[1].split(" N (RMS)")[0])
    assert size == pytest.approx(float(np.sqrt(np.mean(np.sum(force**2, axis=1)))), rel=TOLERANCE)


@pytest.mark.parametrize("name", NAMES)
def test_the_torques_of_single_joints_are_no_force(name: str):
    """Torques of the same size, each with a time of its own, as no force causes them together."""
    case = sound(11, name=name)
    torque = felt(case, wandering(case))
    assert case.recording.effort is not None
    shifted = np.column_stack([np.roll(column, 997 * j) for j, column in enumerate(torque.T)])
    case = case.logged(effort=case.recording.effort + shifted)
    assert CODE not in {f.code for f in diagnose_recording(case.robot, case.recording, case.reading)}


@pytest.mark.parametrize("seed", [3, 11])
def test_a_sound_log_has_no_force(seed: int, monkeypatch: pytest.MonkeyPatch):
    """Also where forces of half the evidence count."""
    monkeypatch.setattr(force_at_tip, "GAIN", 0.5 * force_at_tip.GAIN)
    case = sound(seed)
    assert CODE not in {f.code for f in diagnose_recording(case.robot, case.recording, case.reading)}


def test_the_interpolation_is_exact_for_lines():
    time = np.concatenate([np.arange(0.0, 3.0, 0.07), np.arange(10.0, 12.0, 0.07)])
    nodes = force_at_tip.Nodes(time)
    ones = np.ones((1, nodes.count))
    np.testing.assert_allclose(nodes.interpolated(ones), 1.0)
    weights = np.random.default_rng(0).uniform(0.5, 1.0, len(time))
    functions = nodes.interpolated(np.eye(nodes.count))
    np.testing.assert_allclose(nodes.sums(weights[None])[0], functions @ weights)
    whole = nodes.products(np.broadcast_to(weights, (3, 3, len(time))))
    np.testing.assert_allclose(whole[: nodes.count, : nodes.count], (functions * weights) @ functions.T)
