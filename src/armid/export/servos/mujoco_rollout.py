"""Check of a written MJCF: motion of MuJoCo under recorded commands, compared with the roll-out of armid."""

from __future__ import annotations

import importlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from armid.checked_array import Array
from armid.errors import OutputError
from armid.export.other_programs import without_log
from armid.export.servos.mjcf_actuators import TIMESTEP
from armid.servo.closed_loop import simulate
from armid.servo.held_command import held_means
from armid.servo.parameters import ServoModel, ServoParameters
from armid.servo.servo_run import ServoRun

SAME = 5e-4
"""Largest RMS difference of the positions of both roll-outs [rad or m]. Both integrate with finite steps; this is a
third of the step of an encoder with 12 bit."""

SECONDS = 20.0
"""Length of the part of each run, from its beginning, that `armid servo` compares [s]."""


@dataclass(frozen=True, eq=False, slots=True)
class RollOutComparison:
    """Difference of the motions of MuJoCo and armid.

    Attributes:
        rms: RMS difference of each joint over all runs, shape (n,) [rad or m].
        version: Version of MuJoCo.
        seconds: Length of the compared motion [s].
    """

    rms: Array
    version: str
    seconds: float

    @property
    def total(self) -> float:
        """RMS over the joints [rad or m]."""
        return float(np.sqrt(np.mean(self.rms**2)))


def compare_roll_outs(
    path: Path | str, model: ServoModel, parameters: ServoParameters, runs: Sequence[ServoRun]
) -> RollOutComparison | None:
    """Compares the motion of a written MJCF in MuJoCo with that of armid; `None` if MuJoCo is not installed.

    Commands are delayed as identified. Contacts and limits of positions are switched off, because the roll-out of
    armid has none. The step of MuJoCo is the longest of at most `TIMESTEP` that divides the step of the recording.

    Args:
        path: The MJCF.
        model: Arm and friction laws.
        parameters: Identified parameters.
        runs: Commands and initial states.

    Raises:
        OutputError: MuJoCo refuses the file.
    """
    try:
        mj: Any = importlib.import_module("mujoco")
    except ImportError:
        return None
    ours = simulate(model, parameters, runs)
    differences: list[Array] = []
    with without_log(mj):
        try:
            written = mj.MjModel.from_xml_path(str(path))
        except ValueError as error:
            raise OutputError(
                f"MuJoCo refuses {path}: {' '.join(str(error).split())}.",
                remedy="report this, with the description.",
            ) from error
        for run, simulated in zip(runs, ours, strict=True):
            differences.append(_rolled(mj, written, model, parameters, run) - simulated.q)
    rms = np.sqrt(np.mean(np.concatenate(differences) ** 2, axis=0))
    return RollOutComparison(rms, str(mj.__version__), sum(run.seconds for run in runs))


def beginnings(runs: Sequence[ServoRun]) -> list[ServoRun]:
    """The first `SECONDS` of each run."""
    return [run.part(0, min(run.samples, round(SECONDS / run.step) + 1)) for run in runs]


def _rolled(mj: Any, written: Any, model: ServoModel, parameters: ServoParameters, run: ServoRun) -> Array:
    """Positions of MuJoCo at the samples of a run, shape (N, n) [rad or m]."""
    names = model.robot.joint_names
    places = [int(written.joint(name).qposadr[0]) for name in names]
    speeds = [int(written.joint(name).dofadr[0]) for name in names]
    controls = [_actuator_of(mj, written, written.joint(name).id) for name in names]
    each = int(np.ceil(run.step / TIMESTEP * (1.0 - 1e-9)))
    step, steps = run.step / each, (run.samples - 1) * each
    written.opt.timestep = step
    written.opt.disableflags |= mj.mjtDisableBit.mjDSBL_CONTACT | mj.mjtDisableBit.mjDSBL_LIMIT
    data = mj.MjData(written)
    data.qpos[places], data.qvel[speeds] = run.q[0], run.dq
    command, _ = held_means(run.command_time, run.command, parameters.delay, run.start, step, steps)
    found = np.empty_like(run.q)
    found[0] = data.qpos[places]
    for k in range(steps):
        data.ctrl[controls] = command[k]
        mj.mj_step(written, data)
        if (k + 1) % each == 0:
            found[(k + 1) // each] = data.qpos[places]
    return found


def _actuator_of(mj: Any, written: Any, joint: int) -> int:
    """Index of the actuator of a joint."""
    kind = int(mj.mjtTrn.mjTRN_JOINT)
    of_joints = (np.asarray(written.actuator_trntype) == kind) & (np.asarray(written.actuator_trnid)[:, 0] == joint)
    return int(np.flatnonzero(of_joints)[0])
