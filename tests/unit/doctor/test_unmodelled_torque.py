"""Torques that the model lacks: named with their law, and healed by the term that has it."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from armid import kernel
from armid.errors import Finding
from armid.model.motion import Motion
from armid.study.diagnosis import diagnose_recording
from healing import told_after
from sick import Case, sound

UR10E = 4
"""Seed of a log of this arm."""

SIZE = 0.6
"""Size of the added torque, in standard deviations of the torque of the joint."""

CODES = {"friction-missing", "residual-by-angle"}


def told(case: Case) -> list[Finding]:
    found = diagnose_recording(case.robot, case.recording, case.reading)
    return [f for f in found if f.code in CODES]


def with_torque(law: Callable[[Motion, int], np.ndarray], joint: int) -> Case:
    case = sound(UR10E)
    assert case.recording.effort is not None
    effort, added = case.recording.effort.copy(), law(case.motion, joint)
    effort[:, joint] += SIZE * effort[:, joint].std() * added / added.std()
    return case.logged(effort=effort)


def path(motion: Motion, joint: int) -> np.ndarray:
    state = kernel.play(motion.q, np.array([joint], dtype=np.int32), np.array([0.05]))[0][:, 0]
    return motion.q[:, joint] - state


LAWS: dict[str, tuple[str, Callable[[Motion, int], np.ndarray]]] = {
    "power-viscous": ("friction-missing", lambda m, j: m.dq[:, j] * np.abs(m.dq[:, j])),
    "hysteresis": ("friction-missing", path),
    "ripple": ("residual-by-angle", lambda m, j: np.sin(15.0 * m.q[:, j])),
}


@pytest.mark.parametrize("term", LAWS)
@pytest.mark.parametrize("joint", [1, 2])
def test_the_law_is_named_and_its_term_heals(term: str, joint: int):
    code, law = LAWS[term]
    case = with_torque(law, joint)
    (found,) = told(case)
    assert (found.code, found.severity, found.channel) == (code, "warning", case.robot.joint_names[joint])
    assert f'"{term}"' in found.remedy and "[model]" in found.remedy
    assert not told_after(case, found) & CODES


def test_a_spring_about_a_vertical_axis_is_named():
    """No weight acts on the first joint, so nothing in the model looks like a spring."""
    case = with_torque(lambda m, j: m.q[:, j], 0)
    (found,) = told(case)
    assert (found.code, found.channel) == ("residual-by-angle", case.robot.joint_names[0])
    assert "spring" in found.evidence and found.remedy.startswith("find out")


LOCAL: dict[str, tuple[str, Callable[[Motion, int], np.ndarray]]] = {
    "tooth": ("friction", lambda m, j: np.tanh(m.dq[:, j] / 0.02) * near(m.q[:, j], 0.1)),
    "rubbing": ("friction", lambda m, j: np.sign(m.dq[:, j]) * (np.abs(m.q[:, j] - middle(m.q[:, j])) < 0.2)),
}


def middle(q: np.ndarray) -> float:
    return float(np.median(q))


def near(q: np.ndarray, width: float) -> np.ndarray:
    return np.exp(-(((q - middle(q)) / width) ** 2))


@pytest.mark.parametrize("law", LOCAL)
def test_friction_at_one_angle_is_named_with_the_angle(law: str):
    case = with_torque(LOCAL[law][1], 2)
    (found,) = told(case)
    assert (found.code, found.channel) == ("residual-by-angle", case.robot.joint_names[2])
    assert LOCAL[law][0] in found.evidence and "tooth" in found.remedy
    angle = float(found.evidence.split("acts at ")[1].split(" ")[0])
    assert angle == pytest.approx(middle(case.motion.q[:, 2]), abs=0.1)  # half the width of the friction


@pytest.mark.parametrize("waves", [8.0, 15.0])
def test_a_gain_that_swings_with_the_angle_is_named(waves: float):
    case = sound(UR10E)
    assert case.recording.effort is not None
    effort = case.recording.effort.copy()
    effort[:, 2] *= 1.0 + 0.3 * np.cos(waves * case.motion.q[:, 2] + 1.0)
    (found,) = told(case.logged(effort=effort))
    assert (found.code, found.channel) == ("residual-by-angle", case.robot.joint_names[2])
    named = float(found.evidence.split("swings, with ")[1].split(" ")[0])
    assert named == pytest.approx(waves, abs=1.5)  # the joint turns by two radians: a wave more is half a radian
    assert "calibrate" in found.remedy


@pytest.mark.parametrize(
    ("joints", "sense", "shape"),
    [
        ((1, 2), 1, lambda x: np.maximum(x - np.quantile(x, 0.7), 0.0)),
        ((2, 3), -1, lambda x: np.maximum(x - np.quantile(x, 0.5), 0.0) ** 1.5),
        ((0, 3), 1, lambda x: -np.maximum(np.quantile(x, 0.4) - x, 0.0)),
    ],
)
def test_a_cable_over_two_joints_is_named(joints: tuple[int, int], sense: int, shape: Callable[..., np.ndarray]):
    case = sound(UR10E)
    assert case.recording.effort is not None
    i, j = joints
    turned = case.motion.q[:, i] + sense * case.motion.q[:, j]
    pull, effort = shape(turned), case.recording.effort.copy()
    for k, lever in ((i, 1.0), (j, sense * 0.8)):
        effort[:, k] += lever * effort[:, [i, j]].std(axis=0).min() * pull / pull.std()
    (found,) = told(case.logged(effort=effort))
    assert found.code == "residual-by-angle" and "cable" in found.evidence
    assert found.channel == ", ".join(case.robot.joint_names[k] for k in joints)


@pytest.mark.parametrize("seed", [2, UR10E, 12, 51])
def test_friction_with_a_stribeck_part_and_an_asymmetry_is_told_nothing(seed: int):
    assert told(sound(seed)) == []
