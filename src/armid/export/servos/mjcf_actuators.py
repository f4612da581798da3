"""MJCF of an arm whose joints are held to commands: bodies, friction and actuators of an identification of servos."""

from __future__ import annotations

import math
from dataclasses import replace
from xml.sax.saxutils import quoteattr

import numpy as np

from armid.export.formats.mjcf import PLACES, write
from armid.export.types import Content, text_of
from armid.model.terms import RotorInertia
from armid.robot.robot import InertialParameters
from armid.servo.parameters import ServoModel, ServoParameters

TIMESTEP = 1e-3
"""Time step of the file [s]."""

DRY = f'solreffriction="{2.0 * TIMESTEP:g} 1" solimpfriction="0.9999 0.9999 0.001 0.5 2"'
"""Attributes with which MuJoCo's constraint of dry friction is stiff. With its defaults, a joint at rest creeps under
load."""


def servo_mjcf(model: ServoModel, parameters: ServoParameters) -> bytes:
    """MJCF with `general` actuators, whose bias contains stiffness, damping and offset of each servo.

    The control of an actuator is the command. MuJoCo has no delay of a command: the control must be delayed by the
    program that sets it. Friction laws other than viscous and Coulomb have no place in the format.
    """
    robot = model.robot
    links = [
        replace(link, inertial=InertialParameters.from_vector(vector))
        for link, vector in zip(robot.links, parameters.inertial, strict=True)
    ]
    joints: dict[str, dict[str, float]] = {
        joint.name: {RotorInertia.name: float(rotor)}
        for joint, rotor in zip(robot.joints, parameters.rotor_inertia, strict=True)
    }
    for name, law, value in zip(model.terms, model.laws, parameters.friction, strict=True):
        if name in PLACES:
            joints[robot.joints[law.joint].name][name] = float(value)
    limits = zip(robot.joints, parameters.limit, strict=True)  # MuJoCo keeps to the smaller of two limits
    own = [replace(joint, effort_limit=float(limit)) for joint, limit in limits]
    text = write(Content(replace(robot, joints=own, links=links), joints)).data.decode()
    option = f'  <option timestep="{TIMESTEP:g}" integrator="implicitfast"/>\n'
    option += f"  <default>\n    <joint {DRY}/>\n  </default>\n"
    text = text.replace("  <worldbody>\n", f"{option}  <worldbody>\n", 1)
    lines = ["  <actuator>"]
    for j, joint in enumerate(robot.joints):
        kp, kd, offset = parameters.stiffness[j], parameters.damping[j], parameters.offset[j]
        limit = parameters.limit[j]
        force = f' forcerange="{text_of(-limit, limit)}"' if math.isfinite(limit) else ""
        lines.append(
            f'    <general name={quoteattr(joint.name)} joint={quoteattr(joint.name)} biastype="affine" '
            f'gainprm="{text_of(kp)}" biasprm="{text_of(-kp * offset, -kp, -kd)}"{force}/>'
        )
    if np.any(parameters.delay):
        delays = ", ".join(f"{1e3 * delay:.3g}" for delay in parameters.delay)
        lines.insert(
            0, f"  <!-- Delay of the commands, which MuJoCo does not have, joint by joint [ms]: {delays} -->"
        )
    lines.append("  </actuator>")
    return text.replace("</mujoco>", "\n".join([*lines, "</mujoco>"]), 1).encode()
