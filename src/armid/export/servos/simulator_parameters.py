"""Parameters of servos under the names of other programs: BAM, Isaac Lab with PhysX, and mjlab.

The names are those of `bam.model.Model` (better-actuator-models), of `isaaclab.actuators.ActuatorBaseCfg` with the
friction model of PhysX 5.6, and of `mjlab.actuator.BuiltinPositionActuatorCfg`.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from typing import Any

from armid.export.servos.mjcf_actuators import TIMESTEP, joint_values
from armid.model.terms import Coulomb, RotorInertia, Viscous
from armid.servo.parameters import ServoModel, ServoParameters

PARAMETERS_FORMAT = 1
"""Number of the format of `simulators.json`."""

UNITS = {
    "turning joint": {
        "stiffness": "N*m/rad", "damping": "N*m*s/rad", "friction": "N*m", "viscous friction": "N*m*s/rad",
        "armature": "kg*m^2", "effort": "N*m", "offset": "rad", "delay": "s",
    },
    "sliding joint": {
        "stiffness": "N/m", "damping": "N*s/m", "friction": "N", "viscous friction": "N*s/m",
        "armature": "kg", "effort": "N", "offset": "m", "delay": "s",
    },
}  # fmt: skip
"""Units of all values, by the kind of the joint; PhysX itself has them, too. An asset in USD states gains of turning
joints by degree."""

NOTES = {
    "isaaclab": "Static and dynamic friction are equal: the model has no Stribeck effect. Of PhysX 5.6 on. The "
    "command is the position target minus the offset, delayed.",
    "mjlab": "The lag of the command is in steps of timestep; a negative delay cannot be stated and is 0. The "
    "command is the position target minus the offset.",
    "bam": "Model m1. BAM computes the torque of the motor from a voltage: stiffness stands for "
    "vin * kp * error_gain * kt / R, and friction_viscous contains kt^2 / R, because command and position do not "
    "show kt and R apart. BAM adds q_offset to the angle in the weight of its test bench, too; here only the servo "
    "has the offset.",
}
"""Meaning of the names of each program for these values."""


def simulator_parameters(model: ServoModel, parameters: ServoParameters) -> dict[str, Any]:
    """Content of `simulators.json`: the parameters under the names of each program, with units and notes."""
    joints = {joint.name: "sliding joint" if joint.is_prismatic else "turning joint" for joint in model.robot.joints}
    return {
        "format": PARAMETERS_FORMAT,
        "robot": model.robot.name,
        "joints": joints,
        "units": UNITS,
        "notes": NOTES,
        "offset": _by_joint(model, parameters.offset),
        "delay": _by_joint(model, parameters.delay),
        "not_stated": [
            f"{law.symbol} of {model.robot.joint_names[law.joint]}"
            for name, law in zip(model.terms, model.laws, strict=True)
            if name not in (Viscous.name, Coulomb.name)
        ],
        "isaaclab": _isaaclab(model, parameters),
        "mjlab": [_mjlab(model, parameters, j) for j in range(model.n)],
        "bam": {joint.name: _bam(model, parameters, j) for j, joint in enumerate(model.robot.joints)},
    }


def _isaaclab(model: ServoModel, parameters: ServoParameters) -> dict[str, Any]:
    """Arguments of an `ImplicitActuatorCfg`; each value by the name of the joint."""
    values = joint_values(model, parameters)
    dry = {name: each.get(Coulomb.name, 0.0) for name, each in values.items()}
    limits = {name: each for name, each in _by_joint(model, parameters.limit).items() if math.isfinite(each)}
    return {
        "joint_names_expr": [re.escape(name) for name in model.robot.joint_names],
        "stiffness": _by_joint(model, parameters.stiffness),
        "damping": _by_joint(model, parameters.damping),
        "armature": {name: each[RotorInertia.name] for name, each in values.items()},
        "friction": dry,
        "dynamic_friction": dict(dry),
        "viscous_friction": {name: each.get(Viscous.name, 0.0) for name, each in values.items()},
        **({"effort_limit_sim": limits} if limits else {}),
    }


def _mjlab(model: ServoModel, parameters: ServoParameters, j: int) -> dict[str, Any]:
    """Arguments of the `BuiltinPositionActuatorCfg` of a joint."""
    name, limit = model.robot.joint_names[j], float(parameters.limit[j])
    values = joint_values(model, parameters)[name]
    lag = max(0, round(float(parameters.delay[j]) / TIMESTEP))
    return {
        "target_names_expr": [re.escape(name)],
        "stiffness": float(parameters.stiffness[j]),
        "damping": float(parameters.damping[j]),
        **({"effort_limit": limit} if math.isfinite(limit) else {}),
        "armature": values[RotorInertia.name],
        "frictionloss": values.get(Coulomb.name, 0.0),
        "viscous_damping": values.get(Viscous.name, 0.0),
        "delay_min_lag": lag,
        "delay_max_lag": lag,
        "timestep": TIMESTEP,
    }


def _bam(model: ServoModel, parameters: ServoParameters, j: int) -> dict[str, Any]:
    """Parameters of the model `m1` of a joint; the damping of the servo counts as viscous friction."""
    values = joint_values(model, parameters)[model.robot.joint_names[j]]
    return {
        "model": "m1",
        "stiffness": float(parameters.stiffness[j]),
        "armature": values[RotorInertia.name],
        "q_offset": float(parameters.offset[j]),
        "command_delay": float(parameters.delay[j]),
        "friction_base": values.get(Coulomb.name, 0.0),
        "friction_viscous": values.get(Viscous.name, 0.0) + float(parameters.damping[j]),
    }


def _by_joint(model: ServoModel, values: Any) -> Mapping[str, float]:
    """Values by the names of the joints."""
    return {name: float(value) for name, value in zip(model.robot.joint_names, values, strict=True)}
