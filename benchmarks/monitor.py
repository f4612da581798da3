"""Pushes that `armid monitor` finds on simulated arms, and the rate of its false alarms on other motion.

    python benchmarks/monitor.py [--arm NAME]… [--logs 167] [--minutes 15] [--hours 1] [--cache DIR] [--json]

Each arm has rotors and a Stribeck effect that the model lacks. It is identified on one motion by inverse dynamics;
thresholds come from reference motion of some minutes, for the smallest rate that it can promise. Then other motion
without contact is watched for hours: printed is the ratio of the false alarms to those promised. Pushes are steps of
15 % of the torque limit of a random joint at a random time, in closed loop in MuJoCo, so that the arm yields; a push
is found if a joint exceeds its threshold within 50 ms. All motions are random Fourier series.
"""

from __future__ import annotations

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("OMP_NUM_THREADS", "1")

import argparse
import json
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from armid.excitation.fourier import Excitation
from armid.lab.controller import Controller
from armid.lab.known_arms import KnownArm, truth_of
from armid.lab.options import Arm, LabOptions
from armid.lab.pushes import Push
from armid.lab.sensors import Sensing, SensorChannel
from armid.lab.simulation import simulate
from armid.measurement.recording import Recording
from armid.robot import load_robot
from armid.runs.monitoring.monitor import Monitor, make_monitor, watch
from armid.runs.monitoring.observer import ObserverOptions
from armid.runs.run import Run, load_run, save_run
from armid.study.config import ModelChoice, RecordingChoice, RobotChoice, Study
from armid.study.identify import identify

ARMS = ("iiwa14-r820", "panda", "ur10e")

EFFECTS = ("rotor", "stribeck")

TERMS = ("rigid-body", "viscous", "coulomb", "offset", "rotor-inertia")

SHARE, WITHIN = 0.15, 0.05
"""Push divided by the torque limit, and time in which it must be found [s]."""

RATE = 500.0
"""Rate of the logs [Hz]."""

PUSHED = 2.5
"""Duration of a log with a push [s]."""

USED_RANGE, USED_SPEED, USED_ACCELERATION = 0.6, 0.5, 6.0
"""Shares of the range and of the velocity limits that motions use, and highest acceleration [rad/s²]."""


@dataclass(frozen=True)
class Row:
    """Results of an arm; `found` counts pushes, `joint` those whose own joint gave the alarm, `late` in ms."""

    arm: str
    per_hour: float
    hours: float
    false_alarms: int
    ratio: float
    pushes: int
    found: int
    joint: int
    late: float
    thresholds: list[float]
    limits: list[float]


def random_plan(truth: KnownArm, rng: np.random.Generator, period: float, harmonics: int = 5) -> Excitation:
    """Random motion inside of the limits."""
    joints = truth.robot.joints
    base = 2.0 * np.pi / period
    a, b = rng.normal(size=(2, len(joints), harmonics))
    low, high = np.array([np.clip(joint.position_limits, -np.pi, np.pi) for joint in joints]).T
    motion = Excitation(base, a, b, np.zeros(len(joints))).at(np.linspace(0.0, period, 500))
    span = np.ptp(motion.q, axis=0)
    speed = np.array([min(joint.velocity_limit, 3.0) for joint in joints])
    factors = [
        USED_RANGE * (high - low) / span,
        USED_SPEED * speed / np.abs(motion.dq).max(axis=0),
        USED_ACCELERATION / np.abs(motion.ddq).max(axis=0),
    ]
    size = np.min(factors, axis=0) * rng.uniform(0.4, 1.0, len(joints))
    a, b = a * size[:, None], b * size[:, None]
    middle = 0.5 * (motion.q.max(axis=0) + motion.q.min(axis=0)) * size
    room = 0.5 * (high - low) - 0.5 * span * size
    return Excitation(base, a, b, 0.5 * (high + low) - middle + room * rng.uniform(-0.8, 0.8, len(joints)))


def free_motion(truth: KnownArm, options: LabOptions, seconds: float, seed: int) -> list[Recording]:
    """Recordings without contact along random motions of 5 to 20 s, each run through once or twice."""
    rng = np.random.default_rng(seed)
    result: list[Recording] = []
    left = seconds
    while left > 0.0:
        plan = random_plan(truth, rng, float(rng.choice([5.0, 10.0, 20.0])))
        repetitions = int(rng.integers(1, 3))
        own = replace(options, mode="inverse-dynamics", repetitions=repetitions)
        result.append(simulate(truth, plan, own, seed=int(rng.integers(2**31))).recording)
        left -= repetitions * plan.period
    return result


def lab_options() -> LabOptions:
    """Arms with effects that the model lacks, and sensors of usual noise."""
    sensing = Sensing(RATE, SensorChannel(noise=1e-5), SensorChannel(noise=0.3))
    return LabOptions(
        arm=Arm(effects=EFFECTS),
        sensing=sensing,
        lead_in=0.5,
        controller=Controller(friction=0.5),
        physics_rate=2000.0,
    )


def identified(name: str, truth: KnownArm, options: LabOptions, folder: Path, seconds: float = 60.0) -> Run:
    """Run of an arm, identified on one random motion."""
    plan = random_plan(truth, np.random.default_rng(7), 20.0)
    own = replace(options, mode="inverse-dynamics", repetitions=max(1, round(seconds / plan.period)))
    recording = simulate(truth, plan, own, seed=7).recording
    choice = RecordingChoice("train")
    study = Study(RobotChoice(name), ModelChoice(TERMS), (choice,))
    return load_run(save_run(identify(study, given={"train": recording}), folder / name))


def pushed(truth: KnownArm, options: LabOptions, seed: int) -> tuple[Recording, Push]:
    """Log in closed loop with a push on a random joint."""
    rng = np.random.default_rng(seed)
    plan = random_plan(truth, rng, PUSHED, harmonics=3)
    joint = int(rng.integers(truth.robot.n))
    torque = SHARE * truth.robot.joints[joint].effort_limit * float(rng.choice([-1.0, 1.0]))
    push = Push(joint, torque, float(rng.uniform(1.1, PUSHED - 0.2)), 0.2)
    return simulate(truth, plan, replace(options, pushes=(push,)), seed=seed).recording, push


def cached_push(truth: KnownArm, options: LabOptions, seed: int, cache: Path | None) -> tuple[Recording, Push]:
    """Log with a push; a folder keeps it for the next call."""
    if cache is None:
        return pushed(truth, options, seed)
    path = cache / f"{truth.robot.name}_{seed}.npz"
    if not path.is_file():
        recording, push = pushed(truth, options, seed)
        cache.mkdir(parents=True, exist_ok=True)
        assert recording.time is not None and recording.effort is not None
        kept = {"time": recording.time, "q": recording.q, "effort": recording.effort}
        np.savez(path, allow_pickle=False, push=list(asdict(push).values()), **kept)  # pyright: ignore
    with np.load(path) as kept:
        joint, *rest = kept["push"].tolist()
        recording = Recording(kept["time"], kept["q"], effort=kept["effort"], consecutive=True)
    return recording, Push(int(joint), *rest)


def delay_of(monitor: Monitor, recording: Recording, push: Push) -> tuple[float, bool]:
    """Time from a push to the first exceedance [s], infinite if there is none; and whether it is of its joint."""
    seen = watch(monitor, recording)
    (part,), (along,) = seen.parts, seen.thresholds
    over = (np.abs(part.external) > along) & part.usable
    during = (part.time >= push.start) & (part.time < push.start + push.seconds)
    at = np.flatnonzero(over.any(axis=1) & during)
    if not len(at):
        return np.inf, False
    soon = during & (part.time <= push.start + WITHIN)
    return float(part.time[at[0]] - push.start), bool(over[soon, push.joint].any())


def false_alarms(monitor: Monitor, recordings: Sequence[Recording]) -> tuple[int, float]:
    """Number of alarms, and hours in which they were possible."""
    seen = [watch(monitor, each) for each in recordings]
    return sum(len(each.alarms) for each in seen), sum(each.seconds for each in seen) / 3600.0


def measure(
    name: str,
    folder: Path,
    *,
    logs: int,
    minutes: float,
    hours: float,
    kind: str = "momentum",
    per_hour: float | None = None,
    cache: Path | None = None,
) -> Row:
    """All figures of an arm."""
    truth, options = truth_of(load_robot(name)), lab_options()
    run = identified(name, truth, options, folder)
    references = free_motion(truth, options, 60.0 * minutes, 11)
    made = make_monitor(
        run, references=references, false_alarms=per_hour, options=ObserverOptions(kind)  # pyright: ignore
    )  # fmt: skip
    alarms, watched = 0, 0.0
    for k in range(max(1, round(12 * hours))):
        more, time = false_alarms(
            made, free_motion(truth, options, 3600.0 * hours / max(1, round(12 * hours)), 100 + k)
        )
        alarms, watched = alarms + more, watched + time
    results = [delay_of(made, *cached_push(truth, options, 1000 + k, cache)) for k in range(logs)]
    late = np.array([each for each, _ in results])
    found = late <= WITHIN
    return Row(
        name,
        made.thresholds.rate,
        watched,
        alarms,
        alarms / (made.thresholds.rate * watched),
        logs,
        int(found.sum()),
        sum(own for _, own in results),
        1000.0 * float(np.median(late)) if logs else 0.0,
        made.thresholds.mean.tolist(),
        [joint.effort_limit for joint in truth.robot.joints],
    )


def line(row: Row) -> str:
    """A row of the table."""
    return (
        f"{row.arm:<14}{row.found} of {row.pushes} pushes within 50 ms ({row.joint} on their joint, median "
        f"{row.late:.0f} ms); {row.false_alarms} false alarms in {row.hours:.2f} h, promised {row.per_hour:.1f} per "
        f"hour: ratio {row.ratio:.2f}; thresholds {' '.join(f'{x:.2g}' for x in row.thresholds)}"
    )


def main() -> int:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--arm", action="append", help="only these arms")
    parser.add_argument("--logs", type=int, default=167, help="pushes of each arm")
    parser.add_argument("--minutes", type=float, default=15.0, help="reference motion")
    parser.add_argument("--hours", type=float, default=1.0, help="other motion")
    parser.add_argument("--per-hour", type=float, help="false alarms; by default the smallest rate promised")
    parser.add_argument("--cache", type=Path, metavar="DIR", help="folder that keeps the logs with pushes")
    parser.add_argument("--observer", default="momentum")
    parser.add_argument("--json", action="store_true")
    asked = parser.parse_args()
    rows: list[Row] = []
    with tempfile.TemporaryDirectory() as folder:
        for name in asked.arm or ARMS:
            rows.append(
                measure(
                    name,
                    Path(folder),
                    logs=asked.logs,
                    minutes=asked.minutes,
                    hours=asked.hours,
                    kind=asked.observer,
                    per_hour=asked.per_hour,
                    cache=asked.cache,
                )
            )
            if not asked.json:
                sys.stdout.write(line(rows[-1]) + "\n")
                sys.stdout.flush()
    if asked.json:
        record: list[dict[str, Any]] = [row.__dict__ for row in rows]
        sys.stdout.write(json.dumps(record) + "\n")
    pushes, found = sum(row.pushes for row in rows), sum(row.found for row in rows)
    kept = all(row.ratio <= 1.5 for row in rows)
    sys.stdout.write("" if asked.json else f"{found} of {pushes} found\n")
    return 0 if found >= 0.99 * pushes and kept else 1


if __name__ == "__main__":
    sys.exit(main())
