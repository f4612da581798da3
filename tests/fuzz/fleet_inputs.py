"""Clean inputs of fleets: a fleet file with every form of a unit, its recordings, and the stored fleet."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

FOLDER = "fleet"
"""Folder of the fleet among the clean inputs."""

FLEET = """
[robot]
description = "small.urdf"
gravity = [0.0, 0.0, -9.81]

[model]
terms = ["rigid-body", "viscous", "coulomb", "offset"]
coulomb = { width = 0.02 }

[processing]
cutoff = 5.0
edges = "drop"

[reading]
units = "rad"
period = "none"
torque_sign = [1, 1, 1]

[[unit]]
name = "unit-01"
recordings = ["unit-01.npz"]

[[unit]]
name = "unit-02"
recordings = ["unit-02.npz"]
validate = ["unit-02-held.npz"]

[[unit]]
name = "unit-03"
recordings = ["unit-03.npz"]

[[unit]]
name = "unit-04"

[[unit.recording]]
path = "unit-04.npz"
part = [0.0, 0.9]
joint_offset = [0.0, 0.0, 0.0]
"""

LATER = """
[robot]
description = "small.urdf"
[model]
terms = ["rigid-body", "viscous", "coulomb", "offset"]
coulomb = { width = 0.02 }
[processing]
cutoff = 5.0
edges = "drop"
[[unit]]
name = "unit-01"
recordings = ["unit-02-held.npz"]
[[unit]]
name = "unit-02"
recordings = ["unit-02.npz"]
"""
"""The smallest fleet that can be compared with the stored one."""

UNITS = 4
"""Units of the fleet, the fewest among which odd ones are found."""


def write_fleet_inputs(folder: Path, run: Callable[..., None]) -> None:
    """Writes a fleet file with the recordings of its units, and the fleet that `armid fleet` stores.

    Args:
        folder: Folder of the clean inputs.
        run: Function that runs a command line in this folder.
    """
    from fleets import made_fleet, write_fleet

    place = folder / FOLDER
    place.mkdir()
    write_fleet(made_fleet(UNITS, 3, repetitions=1), place)
    (place / "FLEET.toml").write_text(FLEET)
    (place / "LATER.toml").write_text(LATER)
    run(folder, "fleet", f"{FOLDER}/FLEET.toml", "--no-report", "--out", f"{FOLDER}/stored")
