"""Torque model of a robot description: links, rotor inertia and friction, as far as the description gives them."""

from __future__ import annotations

import numpy as np

from armid.checked_array import Array
from armid.model.dynamics_model import DynamicsModel
from armid.model.terms import Coulomb, RigidBody, RotorInertia, Term, Viscous
from armid.robot.robot import Robot


def described_torque(robot: Robot) -> tuple[DynamicsModel, Array] | None:
    """Dynamics model of a robot description, with the standard parameters (p,) that the description gives.

    The model contains the links and, as far as the description gives them, rotor inertia and friction. The parameters
    of links of unknown inertia are zero. The result is `None` if the description has no inertial parameters.
    """
    inertial = robot.inertial_vector
    if inertial is None:
        return None
    values = described_drives(robot)

    def moved_by(term: str) -> tuple[str, ...] | None:
        return tuple(name for name, value in zip(robot.joint_names, values[term], strict=True) if value) or None

    terms: list[Term] = [RigidBody()]
    for kind in (Viscous, Coulomb, RotorInertia):
        joints = moved_by(kind.name)
        terms += [kind(joints=joints)] if joints else []
    model = DynamicsModel(robot, tuple(terms))
    theta = np.zeros(len(model.parameters))
    theta[model.inertial_columns] = inertial.ravel()
    for k, parameter in enumerate(model.parameters):
        if parameter.kind in values:
            theta[k] = values[parameter.kind][parameter.number - 1]
    return model, theta


def described_drives(robot: Robot) -> dict[str, Array]:
    """Rotor inertia, viscous and Coulomb friction in a description: for each name of a torque term, values (n,)."""
    drives = [joint.drive for joint in robot.joints]
    return {
        RotorInertia.name: np.array([drive.rotor_inertia for drive in drives]),
        Viscous.name: np.array([drive.viscous for drive in drives]),
        Coulomb.name: np.array([drive.coulomb for drive in drives]),
    }


DRIVE_TERMS = {
    "rotor-inertia": ("rotor inertia", ("kg·m²", "kg")),
    "viscous": ("viscous friction", ("N·m·s/rad", "N·s/m")),
    "coulomb": ("Coulomb friction", ("N·m", "N")),
}
"""Rotor inertia and friction by the name of the torque term: name in texts, units for revolute and prismatic
joints."""


def described_torque_text(robot: Robot) -> str:
    """Sentence that lists the values of a description with which the torque is computed."""
    parts: list[str] = []
    for term, values in described_drives(robot).items():
        name, units = DRIVE_TERMS[term]
        texts = [
            f"{value:g} {units[joint.is_prismatic]}" if value else ""
            for joint, value in zip(robot.joints, values, strict=True)
        ]
        entries = [f"{joint.name} {text}" for joint, text in zip(robot.joints, texts, strict=True) if text]
        same = len(set(texts)) == 1 and robot.n > 1
        parts += [f"{name} ({f'{texts[0]} at every joint' if same else ', '.join(entries)})"] if entries else []
    links = "torque is computed from the masses and inertias of the description"
    if not parts:
        return f"{links}, without rotor inertia and friction, because it contains none"
    missing = [name for term, (name, _) in DRIVE_TERMS.items() if not described_drives(robot)[term].any()]
    without = f"; it contains no {' and no '.join(missing)}" if missing else ""
    return f"{links}, and from its {', '.join(parts)}{without}"
