"""Friction that the lab takes from effort limits, where these are no drive's."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from armid.excitation.fourier import Excitation
from armid.lab.detect_placeholder_limits import placeholder_finding
from armid.lab.friction import Friction
from armid.lab.known_arms import OWN, truth_of
from armid.lab.options import Arm, LabOptions
from armid.lab.simulation import simulate, simulation_findings
from armid.robot import load_robot
from labs import LINK, small_plan

TINY = '<robot name="tiny"><link name="base"/>' + "".join(
    LINK.format(i=i, parent="base" if i == 1 else f"link_{i - 1}", x=0, y=0.03, m=0.1, axis="0 1 0")
    for i in (1, 2, 3)
)


def arm(tmp_path, *efforts):
    text = TINY + "</robot>"
    for effort in efforts:
        text = text.replace('effort="80"', f'effort="{effort}" ', 1)
    path = tmp_path / "tiny.urdf"
    path.write_text(text)
    return load_robot(path)


def told(robot, friction=None, effects=()):
    plan: Excitation = small_plan(1)
    options = LabOptions(mode="inverse-dynamics", arm=Arm(effects=effects, friction=friction))
    found = simulation_findings(simulate(truth_of(robot), plan, options))
    return [each for each in found if each.code == "limits-placeholder"]


@pytest.mark.parametrize("efforts", [(1000, 1000, 1000), (1000, 500, 900), (10, 10, 10), (1.0, 0, 1.0)])
@pytest.mark.parametrize("effects", [(), ("hysteresis", "rotor")])
def test_limits_far_above_what_links_need_are_told(tmp_path, efforts, effects):
    (found,) = told(arm(tmp_path, *efforts), effects=effects)
    assert "4 % of the effort limits" in found.evidence and "look like placeholders" in found.evidence
    assert "lab.toml with --options" in found.remedy and "coulomb = [" in found.remedy


def test_what_is_proposed_is_of_the_size_of_the_arm(tmp_path):
    robot = arm(tmp_path, 1000, 1000, 1000)
    (found,) = told(robot)
    values = np.array([float(x) for x in found.remedy.partition("coulomb = [")[2].partition("]")[0].split(",")])
    assert len(values) == robot.n and (values > 0.0).all() and values.max() < 1.0
    assert told(robot, Friction(values, values)) == []


def test_limits_of_drives_are_not(tmp_path):
    assert told(arm(tmp_path, 2.0, 1.0, 0.5)) == []


def test_limits_that_are_not_given_are_said_to_be_so(tmp_path):
    robot = arm(tmp_path)
    robot = replace(robot, joints=tuple(replace(joint, effort_limit=np.inf) for joint in robot.joints))
    (found,) = told(robot)
    assert "the limit 100, which is assumed because the description has none" in found.evidence


@pytest.mark.parametrize("name", OWN)
def test_nothing_is_said_of_arms_with_numbers_of_their_own(name):
    truth = truth_of(load_robot(name))
    assert placeholder_finding(truth, np.full((2, truth.robot.n), 20.0)) is None
