"""Fleets of small arms whose units differ in friction, offsets and torque scales, and the files of such a fleet."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from armid.checked_array import Array
from armid.lab.inverse_dynamics_recording import Sensors, record
from armid.measurement.recording import Recording
from armid.model.dynamics_model import DynamicsModel
from armid.model.terms import Coulomb, Offset, RigidBody, Viscous
from labs import SENSORS, small_model, small_plan, small_truth, write_arm, write_recording

SPREAD, SCALE_SPREAD, OFFSET_SPREAD = 0.15, 0.02, 0.2
"""Standard deviation between units: of friction, relative; of torque scales; of offsets [N·m]."""

HEAD = """
[robot]
description = "small.urdf"
[model]
terms = ["rigid-body", "viscous", "coulomb", "offset"]
coulomb = { width = 0.02 }
"""


@dataclass(frozen=True, eq=False)
class MadeUnit:
    """A unit: true standard parameters and torque scales, with its recordings."""

    name: str
    truth: Array
    scale: Array
    training: Recording
    validation: Recording


def unit_model() -> DynamicsModel:
    """The small arm with viscous and smooth Coulomb friction and offsets."""
    return DynamicsModel(small_model().robot, (RigidBody(), Viscous(), Coulomb(width=0.02), Offset()))


def made_fleet(
    count: int,
    seed: int = 1,
    *,
    odd: Mapping[tuple[int, str], float] | None = None,
    sensors: Sensors = SENSORS,
    repetitions: int = 2,
) -> list[MadeUnit]:
    """Units of the small arm; `odd` multiplies a parameter of a unit, by its number and the parameter's name."""
    model, rng = unit_model(), np.random.default_rng(seed)
    names = [parameter.name for parameter in model.parameters]
    units: list[MadeUnit] = []
    for u in range(count):
        truth = np.zeros(len(names))
        truth[[names.index(parameter.name) for parameter in small_model().parameters]] = small_truth()
        own = np.array([name[:2] in ("FV", "FS") for name in names])
        truth[own] *= 1.0 + SPREAD * rng.standard_normal(int(own.sum()))
        offsets = np.array([name.startswith("FO") for name in names])
        truth[offsets] = OFFSET_SPREAD * rng.standard_normal(int(offsets.sum()))
        for (number, name), factor in (odd or {}).items():
            if number == u:
                truth[names.index(name)] *= factor
        scale = 1.0 + SCALE_SPREAD * rng.standard_normal(model.n)
        recordings: list[Recording] = []
        for motion in (10 + u % 3, 20):
            made = record(model, truth, small_plan(motion), sensors, rng, repetitions=repetitions)[0]
            assert made.effort is not None
            recordings.append(replace(made, effort=made.effort * scale))
        units.append(MadeUnit(f"unit-{u + 1:02d}", truth, scale, *recordings))
    return units


def write_fleet(units: list[MadeUnit], folder: Path, name: str = "FLEET.toml") -> Path:
    """The file of a fleet, beside the arm and the recordings of all units."""
    write_arm(folder)
    text = HEAD
    for unit in units:
        write_recording(unit.training, folder / f"{unit.name}.npz")
        write_recording(unit.validation, folder / f"{unit.name}-held.npz")
        text += (
            f'[[unit]]\nname = "{unit.name}"\nrecordings = ["{unit.name}.npz"]\nvalidate = ["{unit.name}-held.npz"]\n'
        )
    path = folder / name
    path.write_text(text)
    return path
