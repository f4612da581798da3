"""Faults of an MJCF that MuJoCo refuses, and parts that armid does not model: each is refused or told."""

from __future__ import annotations

import pytest

from armid.errors import RobotError
from armid.robot.readers import mjcf

MASS = '<inertial pos="0.1 0 0" mass="2" diaginertia="0.1 0.1 0.1"/>'


def arm(mass: str = MASS, before: str = "", joint: str = "", body: str = "") -> str:
    """One joint that moves a body, with given attributes and a given mass."""
    return (
        f'<mujoco>{before}<worldbody><body name="a" {body}><joint name="j" {joint}/>{mass}'
        f'<body name="b"><joint name="k" axis="0 1 0"/>{MASS}</body></body></worldbody></mujoco>'
    )


def read(text: str):
    return mjcf.read(text, source="arm.xml", locked={}, tip=None)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (arm(before='<compiler coordinate="global"/>'), "gives all poses in the frame of the world"),
        (arm(MASS * 2), "the body 'a' has 2 elements <inertial>"),
        (arm(MASS.replace("diag", 'fullinertia="1 1 1 0 0 0" diag')), "fullinertia.* and also diaginertia"),
        (arm('<inertial mass="1" fullinertia="1 1 1 0 0 0" quat="1 1 0 0"/>'), "fullinertia.* and also quat"),
        (arm(body='quat="1 0 0 0" euler="0 0 0"'), "body 'a' has several orientations: quat, euler"),
        (
            arm(before='<default><default class="c"/></default><default><default class="c"/></default>'),
            "defines the default class 'c' twice",
        ),
    ],
)  # fmt: skip
def test_contradictions_are_refused(text, message):
    with pytest.raises(RobotError, match=message) as told:
        read(text)
    assert told.value.remedy


SPRING = "the springs of the joints j"


@pytest.mark.parametrize(
    ("text", "channel", "words"),
    [
        (arm(body='gravcomp="1"'), "a", "gravcomp of the bodies a"),
        (arm(joint='stiffness="20" springref="30"'), "j", SPRING),
        (arm(before='<default><joint stiffness="2"/></default>'), "j, k", "the springs of the joints j, k"),
        (arm(joint='springdamper="0.1 1"'), "j", SPRING),
        (arm(before='<compiler boundmass="1" balanceinertia="true"/>'), "", "settings balanceinertia, boundmass are"),
    ],
)
def test_parts_that_are_not_modelled_are_named(text, channel, words):
    (found,) = read(text).findings
    assert (found.code, found.severity, found.channel) == ("description-ignored", "warning", channel)
    assert words in found.evidence
    assert found.remedy


@pytest.mark.parametrize(
    "text",
    [
        arm(before='<compiler boundmass="0" boundinertia="0" settotalmass="-1" balanceinertia="false"/>'),
        arm(body='gravcomp="0"', joint='stiffness="0" springref="30" springdamper="0 0"'),
    ],
)
def test_parts_that_are_switched_off_are_not_named(text):
    assert read(text).findings == ()


@pytest.mark.parametrize(
    ("mass", "code"),
    [
        ('<inertial pos="0 0 0" mass="1" fullinertia="0.01 0.01 0.01 0.05 0 0"/>', "inertia-impossible"),
        ('<inertial pos="1 2 3" mass="1" diaginertia="-0.1 0.1 0.1"/>', "inertia-impossible"),
        ('<inertial pos="0 0 0" mass="-1" diaginertia="0.1 0.1 0.1"/>', "inertia-impossible"),
        ('<inertial pos="1 2 3" mass="1"/>', "inertia-missing"),
        ('<inertial pos="0.3 0 0.1" mass="1" diaginertia="0 0 0"/>', "inertia-missing"),
        ('<inertial pos="1 2 3" mass="1" diaginertia="0.1 0.1 1e-9" euler="10 20 30"/>', ""),
        ('<inertial pos="0 0 0" mass="0" diaginertia="0 0 0"/>', ""),
    ],
)
def test_inertias_that_no_moving_body_has_are_named(mass, code):
    told = [(finding.code, finding.channel) for finding in read(arm(mass)).findings]
    assert told == [(code, "a")] * bool(code)
    still = arm().replace("<worldbody>", f'<worldbody><body name="base">{mass}</body>')
    assert not read(still).findings
