"""Servos of two real robots identified by armid and by `mujoco.sysid`: same unknowns, recordings and start.

Both minimise the squared closed-loop position error on the training recordings of `../shared/data`, over stiffness
(if it is not given), viscous and Coulomb friction, rotor inertia, offset and delay of each joint; the links are those
of the description. armid has its exact derivatives, its weights and its prior; `mujoco.sysid.optimize` has its finite
differences over MuJoCo's roll-outs, and bounds. Its unknowns are scaled as those of armid are, and it begins at
armid's first estimate. Both results are judged by the same roll-out on motion that trained neither.

Needs the packages of mujoco[sysid]. Prints one JSON object for each robot: error, CPU time and their ratios.
"""

from __future__ import annotations

import argparse
import importlib
import json
import re
import tempfile
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from armid.checked_array import Array
from armid.export.servos.mjcf_actuators import servo_mjcf
from armid.servo.held_command import held_means
from armid.servo.identify_servo import ServoEstimate
from armid.servo.parameters import ServoModel, ServoParameters
from armid.servo.score import closed_loop_error, command_error
from armid.servo.servo_run import ServoRun
from armid.servo.unknowns import LOGARITHMIC
from armid.study.config import ModelChoice, RecordingChoice, RobotChoice, Study
from armid.study.servos.choice import ServoChoice
from armid.study.servos.identification import identify_servo_study

DATA = Path(__file__).resolve().parents[2] / "shared" / "data"

STEP = 1e-3
"""Longest step of MuJoCo in the search [s]."""

RANGE = {"log": 4.0, "offset": 0.3, "delay": 0.1}
"""Bounds of the unknowns about the start: of logarithms, offsets [rad] and delays [s]."""

SCALE = {"offset": 0.05, "delay": 0.02}
"""Scale of offsets [rad] and delays [s]: prior deviations of armid."""


def so101(folder: Path) -> Study:
    """Four stretches of a hobby arm train, four other motions judge."""
    shares = {"chirp_sweep": 2000 / 6000, "multisine": 1500 / 6000}
    shares |= {"large_amplitude": 2000 / 6652, "workspace_sweep": 1500 / 5465}
    held_out = ("lissajous_pattern", "trapezoidal_profile", "hold_under_gravity", "custom_motion")
    recordings = [RecordingChoice(f"{name}.parquet", part=(0.0, share)) for name, share in shares.items()]
    recordings += [RecordingChoice(f"{name}.parquet", "validate") for name in held_out]
    servo = ServoChoice(link_deviation=0.0)
    return Study(
        RobotChoice("so101_new_calib.xml"), ModelChoice(), tuple(recordings), folder=str(folder), servo=servo
    )


def go2(folder: Path, scratch: Path) -> Study:
    """A leg robot with its trunk held: the first half trains, the next fifth judges; the gains are given."""
    path = scratch / "go2.xml"
    path.write_text(re.sub(r"<freejoint[^>]*/>", "", (folder / "go2.xml").read_text()))
    recording = str(folder / "first70.parquet")
    recordings = (
        RecordingChoice(recording, part=(0.0, 50 / 70)),
        RecordingChoice(recording, "validate", part=(50 / 70, 1.0)),
    )
    servo = ServoChoice(stiffness=20.0, damping=1.5, link_deviation=0.0)
    return Study(RobotChoice(str(path)), ModelChoice(), recordings, servo=servo)


class Peer:
    """Search of `mujoco.sysid` from the first estimate of armid.

    Args:
        estimate: Estimate of armid, whose first estimate and unknowns are used.
        runs: Training runs.
    """

    def __init__(self, estimate: ServoEstimate, runs: Sequence[ServoRun]) -> None:
        self.mujoco: Any = importlib.import_module("mujoco")
        mujoco = self.mujoco
        self.model, self.start, self.runs = estimate.model, estimate.unknowns.mean, runs
        self.places = estimate.unknowns.names()
        self.plant = mujoco.MjModel.from_xml_string(servo_mjcf(self.model, self.start).decode())
        self.plant.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT | mujoco.mjtDisableBit.mjDSBL_LIMIT
        self.data = mujoco.MjData(self.plant)
        self.roll_outs = 0

    def parameters(self, x: Array) -> ServoParameters:
        """Parameters at scaled unknowns x."""
        values = {name: getattr(self.start, name).copy() for name in {field for field, _ in self.places}}
        for (name, k), each in zip(self.places, x, strict=True):
            values[name][k] = (
                values[name][k] * np.exp(each) if name in LOGARITHMIC else values[name][k] + SCALE[name] * each
            )
        return replace(self.start, **values)

    def residuals(self, x: Array, params: Any) -> tuple[list[Array], None, None]:
        """Position errors [mrad] at unknowns (count,) or (count, K), as `mujoco.sysid` asks for them."""
        del params
        if x.ndim == 1:
            return [self._errors(x)], None, None
        return [np.column_stack([self._errors(column) for column in x.T])], None, None

    def _errors(self, x: Array) -> Array:
        parameters = self.parameters(x)
        self.roll_outs += 1
        return np.concatenate([self._of_run(parameters, run).ravel() for run in self.runs])

    def _of_run(self, parameters: ServoParameters, run: ServoRun) -> Array:
        """Errors on one run [mrad] after its first second."""
        mujoco, plant, n = self.mujoco, self.plant, self.model.n
        rollout: Any = importlib.import_module("mujoco.rollout")
        write(plant, self.model, parameters)
        each = int(np.ceil(run.step / STEP * (1.0 - 1e-9)))
        plant.opt.timestep = run.step / each
        plant.dof_solref[:, 0] = 2.0 * plant.opt.timestep
        commands, _ = held_means(
            run.command_time, run.command, parameters.delay, run.start, plant.opt.timestep, (run.samples - 1) * each
        )
        self.data.qpos[:], self.data.qvel[:], self.data.time = run.q[0], run.dq, 0.0
        state = np.empty(mujoco.mj_stateSize(plant, mujoco.mjtState.mjSTATE_FULLPHYSICS.value))
        mujoco.mj_getState(plant, self.data, state, mujoco.mjtState.mjSTATE_FULLPHYSICS.value)
        states, _ = rollout.rollout(plant, self.data, state, commands)
        q = states[0, each - 1 :: each, 1 : 1 + n]
        return np.asarray(1e3 * (q - run.q[1:])[round(1.0 / run.step) :])

    def search(self, iterations: int) -> ServoParameters:
        """Parameters that `mujoco.sysid` finds."""
        sysid: Any = importlib.import_module("mujoco.sysid")
        params = sysid.ParameterDict()
        for number, (name, k) in enumerate(self.places):
            reach = RANGE["log"] if name in LOGARITHMIC else RANGE[name] / SCALE[name]
            params.add(sysid.Parameter(f"{name}_{k}_{number}", 0.0, -reach, reach))
        found, _ = sysid.optimize(params, self.residuals, max_iters=iterations, verbose=False)
        return self.parameters(found.as_vector())


def write(plant: Any, model: ServoModel, parameters: ServoParameters) -> None:
    """Write parameters into a compiled model of MuJoCo."""
    plant.actuator_gainprm[:, 0] = parameters.stiffness
    plant.actuator_biasprm[:, 0] = -parameters.stiffness * parameters.offset
    plant.actuator_biasprm[:, 1] = -parameters.stiffness
    plant.dof_armature[:] = parameters.rotor_inertia
    for name, law, value in zip(model.terms, model.laws, parameters.friction, strict=True):
        if name == "viscous":
            np.asarray(plant.dof_damping).reshape(plant.nv, -1)[law.joint, 0] = value
        else:
            np.asarray(plant.dof_frictionloss).reshape(plant.nv, -1)[law.joint, 0] = value


def compare(name: str, study: Study, iterations: int) -> dict[str, Any]:
    """Errors [mrad] and CPU times [s] of both programs on one robot."""
    began = time.process_time()
    result = identify_servo_study(study)
    ours = time.process_time() - began
    began, peer = time.process_time(), Peer(result.estimate, result.training)
    found = peer.search(iterations)
    theirs = time.process_time() - began
    judge = {
        "armid": result.estimate.parameters,
        "mujoco.sysid": found,
        "start": result.estimate.unknowns.mean,
    }
    held_out, training = (
        {key: 1e3 * closed_loop_error(peer.model, each, runs).total for key, each in judge.items()}
        for runs in (result.validation, result.training)
    )
    return {
        "robot": name,
        "unknowns": len(peer.places),
        "validation_mrad": {**held_out, "command = position": 1e3 * command_error(result.validation).total},
        "training_mrad": training,
        "cpu_s": {"armid": ours, "mujoco.sysid": theirs},
        "roll_outs": peer.roll_outs,
        "error_ratio": held_out["armid"] / held_out["mujoco.sysid"],
        "time_ratio": theirs / ours,
    }


def main() -> None:
    """Compare the robots that the command line names."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("robots", nargs="*", default=["so101", "go2"], choices=["so101", "go2"])
    parser.add_argument("--iterations", type=int, default=20, help="iterations of mujoco.sysid at most")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as scratch:
        for name in arguments.robots:
            study = so101(DATA / "so101_sage") if name == "so101" else go2(DATA / "go2_stand", Path(scratch))
            print(json.dumps(compare(name, study, arguments.iterations), indent=1), flush=True)


if __name__ == "__main__":
    main()
