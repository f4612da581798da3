"""Words of the doctor on sound logs: `python benchmarks/sound.py [ARM …] [--strangers DIR] [--seeds N] [--json]`.

Each arm is moved by the lab along a motion drawn at random, by inverse dynamics and in closed loop, and the log is
examined as `armid doctor` does it and as an identification does it. Motions keep the limits of position and speed,
and are slowed down until the torque keeps its own. A line a log: arm, joints, mode and what was told, for information
or worse. Nothing is wrong with these logs, so that every error is a false one. Exit code 1 where there is one.

Arms that are neither built in nor in `tests/tables` are those of packages of the package index, unpacked below one
folder by their names (`pip download --no-deps`, then unzip): example-robot-data, robosuite, mani_skill. Those that
are not there are left out, and that is said.
"""

from __future__ import annotations

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("OMP_NUM_THREADS", "1")

import argparse
import json
import re
import sys
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np

from armid.errors import ArmidError, Finding
from armid.excitation.fourier import Excitation
from armid.lab.known_arms import truth_of
from armid.lab.options import LabOptions
from armid.lab.sensors import Sensing, SensorChannel
from armid.lab.simulated_motion import inverse_dynamics
from armid.lab.simulation import simulate
from armid.measurement.convention_conversion import to_robot_convention
from armid.measurement.log_format import LogFormat
from armid.robot import Robot, load_robot
from armid.study.config import ModelChoice, RecordingChoice, build_model
from armid.study.diagnosis import diagnose_recording, run_checks

ROOT = Path(__file__).resolve().parents[1]
DATA = "example_robot_data/cmeel.prefix/share/example-robot-data/robots"
SUITE = "robosuite/robosuite/models/assets/robots"
SKILL = "mani_skill/mani_skill/assets/robots"
MODES: tuple[Literal["inverse-dynamics", "closed-loop"], ...] = ("inverse-dynamics", "closed-loop")

ARMS: dict[str, tuple[str, str]] = {
    **{name: (name, "") for name in ("iiwa14-r820", "iiwa7-r800", "panda", "ur5e", "ur10e")},
    "gantry": ("tests/tables/gantry.toml", ""),
    "scara": ("tests/tables/scara.toml", ""),
    "ur3": (f"{DATA}/ur_description/urdf/ur3_robot.urdf", ""),
    "ur5": (f"{DATA}/ur_description/urdf/ur5_robot.urdf", ""),
    "ur10": (f"{DATA}/ur_description/urdf/ur10_robot.urdf", ""),
    "kinova": (f"{DATA}/kinova_description/robots/kinova.urdf", "j2s6s200_joint_.$"),
    "xarm7": (f"{DATA}/xarm_description/urdf/xarm7.urdf", "joint.$"),
    "z1": (f"{DATA}/z1_description/urdf/z1.urdf", "joint.$"),
    "so101": (f"{DATA}/so_arm_description/urdf/so101.urdf", "shoulder|elbow|wrist"),
    "so100": (f"{DATA}/so_arm_description/urdf/so100.urdf", "shoulder|elbow|wrist|Rotation|Pitch|Elbow|Wrist"),
    "panda-urdf": (f"{DATA}/panda_description/urdf/panda.urdf", "panda_joint.$"),
    "talos": (f"{DATA}/talos_data/robots/talos_left_arm.urdf", "arm_left_"),
    "tiago": (f"{DATA}/tiago_description/robots/tiago_no_hand.urdf", "torso_lift|arm_"),
    "baxter": (f"{DATA}/baxter_description/urdf/baxter.urdf", "left_[sew]"),
    "romeo": (f"{DATA}/romeo_description/urdf/romeo_small.urdf", "L(Shoulder|Elbow|Wrist)"),
    "pendulum": (f"{DATA}/double_pendulum_description/urdf/double_pendulum_simple.urdf", ""),
    "g1": (f"{DATA}/g1_description/urdf/g1_29dof_rev_1_0.urdf", "left_(shoulder|elbow|wrist)"),
    "pr2": (
        f"{DATA}/pr2_description/urdf/pr2.urdf",
        "torso_lift|l_(shoulder|upper_arm|elbow|forearm|wrist)_.*joint$",
    ),
    "hextilt": (f"{DATA}/hextilt_description/urdf/hextilt_flying_arm_5.urdf", ""),
    "humanoid": (f"{DATA}/simple_humanoid_description/urdf/simple_humanoid.urdf", "LARM|larm"),
    "double-pendulum": (f"{DATA}/double_pendulum_description/urdf/double_pendulum.urdf", ""),
    "two-dofs": (f"{DATA}/asr_twodof_description/urdf/TwoDofs.urdf", ""),
    "b1-z1": (f"{DATA}/b1_description/urdf/b1-z1.urdf", "^(z1_)?joint[1-6]$"),
    "anymal-kinova": (f"{DATA}/anymal_b_simple_description/robots/anymal-kinova.urdf", "j2s6s200_joint_.$"),
    "finger": (f"{DATA}/finger_edu_description/robots/finger_edu.urdf", ""),
    "fetch": (f"{SKILL}/fetch/fetch.urdf", "torso_lift|shoulder|upperarm|elbow|forearm|wrist"),
    "xarm7-skill": (f"{SKILL}/xarm7/xarm7.urdf", "joint.$"),
    "jaco": (f"{SUITE}/jaco/robot.xml", ""),
    "kinova3": (f"{SUITE}/kinova3/robot.xml", ""),
    "sawyer": (f"{SUITE}/sawyer/robot.xml", "right_j"),
    "iiwa-suite": (f"{SUITE}/iiwa/robot.xml", ""),
    "tiago-suite": (f"{SUITE}/tiago/robot.xml", "torso|arm_left|left_arm"),
}
"""Description of each arm and the joints that belong to it; the others are locked."""

PERIOD, HARMONICS, REPETITIONS, RATE = 10.0, 5, 2, 250.0

HALF, SPEED, SLIDE = np.pi / 2, 1.0, 0.3
"""Half the range and the speed of joints without limits [rad, rad/s], and the same in metres."""

NOISE = 0.005
"""Noise of the torque in limits of the weakest joint."""

SHARE = 0.7
"""Share of the limits of torque that a motion may need."""


@dataclass(frozen=True, slots=True)
class Told:
    """Words of the doctor on one log.

    Attributes:
        arm: Its name.
        joints: How many.
        mode: How it was moved.
        seed: Of the motion.
        doctor: Findings of `armid doctor`.
        inside: Findings of the doctor in an identification.
        seconds: CPU time of the examination [s].
    """

    arm: str
    joints: int
    mode: str
    seed: int
    doctor: tuple[Finding, ...]
    inside: tuple[Finding, ...]
    seconds: float


def arm(name: str, strangers: Path) -> Robot:
    """One of `ARMS`."""
    where, own = ARMS[name]
    path = ROOT / where if where.startswith("tests/") else strangers / where if "/" in where else where
    if isinstance(path, Path) and not path.is_file():
        raise FileNotFoundError(path)
    if not own:
        return load_robot(path)
    kinds = r"<joint\b(?=[^>]*type=\"(?:revolute|continuous|prismatic|slide|hinge)\")[^>]*name=\"([^\"]+)\"[^>]*>"
    text = re.sub(r"<!--.*?-->", "", Path(path).read_text(), flags=re.DOTALL)
    names = re.findall(kinds, text) if ".urdf" in str(path) else re.findall(r"<joint\b[^>]*name=\"([^\"]+)\"", text)
    return load_robot(path, locked=[name for name in dict.fromkeys(names) if not re.search(own, name)])


def motion(robot: Robot, seed: int) -> Excitation:
    """A motion inside the limits of position and speed, so slow that the torque stays inside its own."""
    rng = np.random.default_rng((29, seed))
    slides = np.array([joint.is_prismatic for joint in robot.joints])
    low, high = np.array([joint.position_limits for joint in robot.joints]).T
    known = np.isfinite(high - low) & (high > low)
    low, high = np.where(known, low, -np.inf), np.where(known, high, np.inf)
    middle = np.where(known, low, 0.0) / 2 + np.where(known, high, 0.0) / 2
    half = np.minimum((high - low) / 2, np.where(slides, SLIDE, HALF))
    speed = np.array([joint.velocity_limit for joint in robot.joints])
    speed = np.minimum(
        np.where((speed > 0.0) & np.isfinite(speed), speed, np.inf), np.where(slides, SLIDE, 3 * SPEED)
    )
    a, b = rng.standard_normal((2, robot.n, HARMONICS))
    drawn = Excitation(2 * np.pi / PERIOD, a, b, np.zeros(robot.n)).sample(50.0)
    by_speed = rng.uniform(0.4, 0.75, robot.n) * speed / np.abs(drawn.dq).max(axis=0)
    by_range = rng.uniform(0.5, 0.8, robot.n) * half / np.abs(drawn.q).max(axis=0)
    scale = np.minimum(by_speed, by_range)[:, None]
    plan = Excitation(2 * np.pi / PERIOD, scale * a, scale * b, middle)
    effort = np.array([joint.effort_limit for joint in robot.joints])
    allowed = np.where((effort > 0.0) & np.isfinite(effort), SHARE * effort, np.inf)
    truth = truth_of(robot)
    for _ in range(6):
        needed = np.abs(inverse_dynamics(truth, plan, 50.0, 1).effort).max(axis=0)
        if (needed <= allowed).all():
            break
        plan = plan.stretched(round(1.25 * plan.period, 1))
    return plan


def examined(name: str, robot: Robot, mode: Literal["inverse-dynamics", "closed-loop"], seed: int) -> Told:
    """One log, as the doctor sees it alone and inside an identification."""
    effort = np.array([joint.effort_limit for joint in robot.joints])
    noise = NOISE * min((limit for limit in effort if 0.0 < limit < np.inf), default=60.0)
    sensing = Sensing(rate=RATE, effort=SensorChannel(noise=noise))
    options = LabOptions(mode=mode, repetitions=REPETITIONS, sensing=sensing)
    log = simulate(truth_of(robot), motion(robot, seed), options, seed=seed).recording
    began = time.process_time()
    found = diagnose_recording(robot, log, LogFormat())
    seconds = time.process_time() - began
    choice = RecordingChoice(f"{name}.csv", reading=LogFormat())
    inside = run_checks(
        build_model(robot, ModelChoice()), [(choice, to_robot_convention(log, LogFormat(), robot).recording)]
    )
    return Told(name, robot.n, mode, seed, found, tuple(finding for _, finding in inside), seconds)


def described(findings: tuple[Finding, ...]) -> str:
    """Codes with what they are and whom they are about."""
    told = [f"{f.code} {f.severity}{f' ({f.channel})' if f.channel else ''}" for f in findings]
    return ", ".join(text for text in dict.fromkeys(told) if not text.startswith("description-rounded"))


def main() -> None:
    """Simulate, examine and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("arms", nargs="*", help=", ".join(ARMS))
    parser.add_argument("--strangers", type=Path, default=Path("strangers"), help="folder of unpacked packages")
    parser.add_argument("--seeds", type=int, default=1)
    parser.add_argument("--first", type=int, default=1)
    parser.add_argument("--verbose", action="store_true")
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    results: list[Told] = []
    left_out: dict[str, str] = {}
    for name in options.arms or ARMS:
        try:
            robot = arm(name, options.strangers)
            for seed in range(options.first, options.first + options.seeds):
                for mode in MODES:
                    results.append(told := examined(name, robot, mode, seed))
                    if not options.json:
                        show(told, verbose=options.verbose)
        except (ArmidError, FileNotFoundError) as error:
            left_out[name] = str(error).splitlines()[0]
            if not options.json:
                print(f"{name:16s} left out: {left_out[name][:160]}", flush=True)
    total = counted(results)
    if options.json:
        logs = [{"arm": t.arm, "mode": t.mode, "seed": t.seed, "told": described(t.doctor)} for t in results]
        print(json.dumps({"total": total, "logs": logs, "left out": left_out}, indent=1))
    else:
        print(", ".join(f"{key} {value}" for key, value in total.items()))
    if total["errors"]:
        sys.exit(1)


def show(told: Told, *, verbose: bool) -> None:
    """A line for a log."""
    inside = "" if described(told.inside) == described(told.doctor) else f" | inside: {described(told.inside) or '-'}"
    print(
        f"{told.arm:16s}{told.joints:3d}  {told.mode:17s}{told.seconds:5.2f} s  "
        f"{described(told.doctor) or '-'}{inside}",
        flush=True,
    )
    for finding in (*told.doctor, *told.inside) if verbose else ():
        if finding.severity != "info":
            print("      ", finding.code, finding.channel, "|", finding.evidence, "|", finding.remedy[:160])


def counted(results: list[Told]) -> dict[str, Any]:
    """Tell how many logs were told an error, a warning or anything."""
    of = {
        key: [f for t in results for f in (*t.doctor, *t.inside) if f.severity == key] for key in ("error", "warning")
    }
    return {
        "arms": len({t.arm for t in results}),
        "logs": len(results),
        "errors": len(of["error"]),
        "warnings": len(of["warning"]),
        "seconds": round(float(np.mean([t.seconds for t in results])), 3) if results else 0.0,
    }


if __name__ == "__main__":
    main()
