"""MJCF of an arm whose joints are held to commands: bodies, friction and actuators of an identification of servos."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from armid.export.formats.mjcf import PLACES, write
from armid.export.types import Content, text_of
from armid.export.xml_edit import element_text
from armid.model.terms import RotorInertia
from armid.robot.robot import InertialParameters, Link, Robot
from armid.servo.parameters import ServoModel, ServoParameters

TIMESTEP = 5e-4
"""Time step of the file [s]. MuJoCo's steps are of first order: with 1 ms, a hobby arm at 50 Hz moves up to 1 mrad
otherwise than with steps that are much shorter."""

OPTIONS = {
    "timestep": f"{TIMESTEP:g}",
    "integrator": "implicitfast",
    "noslip_iterations": "3",
    "noslip_tolerance": "1e-10",
}
"""Options of the file. Without the steps against slip, a joint that dry friction holds creeps: MuJoCo's constraint of
dry friction is soft, and with the smallest softness that it accepts a light joint moved by 3 mrad in 90 s."""

DRY = {"solreffriction": f"{2.0 * TIMESTEP:g} 1", "solimpfriction": "0.9999 0.9999 0.001 0.5 2"}
"""Attributes of joints with which MuJoCo's constraint of dry friction is as stiff as it accepts."""


def servo_mjcf(model: ServoModel, parameters: ServoParameters) -> bytes:
    """MJCF without shapes, with an actuator for each joint, whose control is the command.

    MuJoCo before version 3.5 has no delay of a command, and no version has a negative one, so the file has none: the
    control must be delayed by the program that sets it. Friction laws other than viscous and Coulomb have no place in
    the format.
    """
    links = written_links(model.robot, parameters)
    limits = zip(model.robot.joints, parameters.limit, strict=True)  # MuJoCo keeps to the smaller of two limits
    own = [replace(joint, effort_limit=float(limit)) for joint, limit in limits]
    content = Content(replace(model.robot, joints=own, links=links), joint_values(model, parameters))
    text = write(content).data.decode()
    option = f"  {element_text('option', OPTIONS)}\n"
    option += f"  <default>\n    {element_text('joint', DRY)}\n  </default>\n"
    text = text.replace("  <worldbody>\n", f"{option}  <worldbody>\n", 1)
    lines = actuator_section(model, parameters)
    return text.replace("</mujoco>", "\n".join([*(f"  {line}" for line in lines), "</mujoco>"]), 1).encode()


def written_links(robot: Robot, parameters: ServoParameters) -> list[Link]:
    """Links of an arm with the identified inertial parameters."""
    return [
        replace(link, inertial=InertialParameters.from_vector(vector))
        for link, vector in zip(robot.links, parameters.inertial, strict=True)
    ]


def joint_values(model: ServoModel, parameters: ServoParameters) -> dict[str, dict[str, float]]:
    """Rotor inertia, viscous and Coulomb friction of each joint, by the names of the terms."""
    joints: dict[str, dict[str, float]] = {
        joint.name: {RotorInertia.name: float(rotor)}
        for joint, rotor in zip(model.robot.joints, parameters.rotor_inertia, strict=True)
    }
    for name, law, value in zip(model.terms, model.laws, parameters.friction, strict=True):
        if name in PLACES:
            joints[model.robot.joints[law.joint].name][name] = float(value)
    return joints


def actuator_section(model: ServoModel, parameters: ServoParameters) -> list[str]:
    """Lines of the section `actuator`, with a comment about delays."""
    lines = [f"<!-- {delay_words(parameters)} -->"] if np.any(parameters.delay) else []
    elements = [
        element_text(*actuator(joint.name, joint.name, parameters, j)) for j, joint in enumerate(model.robot.joints)
    ]
    return [*lines, "<actuator>", *(f"  {element}" for element in elements), "</actuator>"]


def delay_words(parameters: ServoParameters) -> str:
    """Sentence about the delays of the commands."""
    delays = ", ".join(f"{1e3 * delay:.3g}" for delay in parameters.delay)
    return f"Delay of the commands, to be applied by the program that sets the controls, by joint [ms]: {delays}"


def actuator(name: str, joint: str, parameters: ServoParameters, j: int) -> tuple[str, Mapping[str, str]]:
    """Tag and attributes of the actuator of joint index j.

    It is a `position` actuator, or, for a servo with an offset, a `general` one, whose bias contains the offset. All
    attributes are stated that the defaults of a description could change.
    """
    kp, kd, offset, limit = (
        float(each[j]) for each in (parameters.stiffness, parameters.damping, parameters.offset, parameters.limit)
    )
    place = {"name": name, "joint": joint, "gear": "1", "ctrllimited": "false"}
    limited = math.isfinite(limit)
    force = {"forcelimited": "true" if limited else "false"}
    force |= {"forcerange": text_of(-limit, limit)} if limited else {}
    if offset == 0.0:
        return "position", {**place, "kp": text_of(kp), "kv": text_of(kd), **force}
    law = {"dyntype": "none", "gaintype": "fixed", "biastype": "affine"}
    numbers = {"gainprm": text_of(kp), "biasprm": text_of(-kp * offset, -kp, -kd)}
    return "general", {**place, **law, **numbers, **force}
