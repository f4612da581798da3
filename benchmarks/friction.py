"""The friction ladder beside one who knows the truth: `python benchmarks/friction.py [--cases N] [--arm NAME]…`.

An arm with Stribeck effect, asymmetry, hysteresis, ripple and offset, all shapes drawn between those of the ladder's
grid, is recorded on one motion and judged on another. `terms = "auto"` as a user gets it stands beside a study that
names the true terms with their true shapes. Both are estimated by `ridge`.
"""

from __future__ import annotations

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("OMP_NUM_THREADS", "1")

import argparse
import json
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from armid.checked_array import Array
from armid.estimation.estimate_record import torque_parameters
from armid.excitation.fourier import Excitation
from armid.hashes import digest
from armid.information.residuals import compare
from armid.maths.inertia import vector_from_pseudo_inertia
from armid.measurement.recording import Recording
from armid.model.dynamics_model import DynamicsModel
from armid.robot import Robot, load_robot
from armid.study.config import EstimationChoice, ModelChoice, RecordingChoice, RobotChoice, Study, build_model
from armid.study.identify import Result, identify
from armid.study.recordings.processed import joined_observations, process_each

ARMS = ("iiwa14-r820", "panda", "ur5e")

RATE, SECONDS, HARMONICS = 200.0, 40.0, 10
"""Of each motion, a random Fourier series up to 0.25 Hz."""

NOISE = 0.05
"""Torque noise in the band over Coulomb friction; the band passes `PASSED` of white noise."""

PASSED = float(np.sqrt(2.0 * 5.0 / RATE))

ENCODER = 1e-5
"""Noise of positions [rad]."""

MOVING = 0.1
"""Speed from which on a joint is away from standstill [rad/s]."""

SHARE = 0.015
"""Coulomb friction over the effort limit."""

OFF = 0.2
"""Deviation of true bodies from the description, where it has any, as a share."""

SIZES = {
    "FV": (0.5, 1.5),
    "FS": (1.0, 1.0),
    "FO": (-0.5, 0.5),
    "FT": (0.4, 1.2),
    "FSA": (-0.4, 0.4),
    "FVA": (-0.4, 0.4),
    "FH": (0.3, 0.9),
    "RS": (-0.4, 0.4),
    "RC": (-0.4, 0.4),
}
"""Parameters of friction over Coulomb friction, drawn evenly."""

BOUND = 1.2
"""RMS of an arm on unseen motion over that of who knows the truth, with noise; above it the benchmark fails."""

TRAIN, UNSEEN = "training", "unseen"


@dataclass(frozen=True, eq=False)
class Truth:
    """An arm whose friction is known.

    Attributes:
        name: Built-in arm.
        choice: The true terms, each joint's shapes.
        model: Arm and true terms.
        theta: True standard parameters, shape (p,).
        coulomb: Size of Coulomb friction, shape (n,) [N·m].
    """

    name: str
    choice: ModelChoice
    model: DynamicsModel
    theta: Array
    coulomb: Array


def draw(name: str, seed: int) -> Truth:
    """An arm with friction of its own."""
    rng = np.random.default_rng((seed, 1))
    robot = load_robot(name)
    choice = _choice(robot, rng)
    model = build_model(robot, choice)
    coulomb = SHARE * np.array([joint.effort_limit for joint in robot.joints]) * rng.uniform(0.7, 1.3, robot.n)
    theta = np.zeros(len(model.parameters))
    theta[model.inertial_columns] = _bodies(robot, rng).ravel()
    for k, parameter in enumerate(model.parameters):
        symbol = next((s for s in sorted(SIZES, key=len, reverse=True) if parameter.symbol.startswith(s)), None)
        if symbol is not None:
            theta[k] = coulomb[parameter.number - 1] * rng.uniform(*SIZES[symbol])
    return Truth(name, choice, model, theta, coulomb)


def _choice(robot: Robot, rng: np.random.Generator) -> ModelChoice:
    """True terms with shapes of each joint."""
    shapes: dict[str, list[dict[str, Any]]] = {"stribeck": [], "hysteresis": [], "ripple": []}
    for joint in robot.joint_names:
        own = {"joints": [joint]}
        velocity = float(np.exp(rng.uniform(np.log(0.04), np.log(0.25))))
        shapes["stribeck"].append({"velocity": velocity, "shape": 2.0, "width": 0.02, **own})
        widths = np.exp(rng.uniform(np.log((0.003, 0.02)), np.log((0.02, 0.08))))
        shapes["hysteresis"].append({"widths": widths.tolist(), **own})
        shapes["ripple"].append({"harmonics": [float(rng.integers(2, 7))], **own})
    terms = ("rigid-body", "viscous", "coulomb", "offset", *shapes, "asymmetric-coulomb", "asymmetric-viscous")
    width = {"width": 0.02}
    return ModelChoice(terms, {**shapes, "coulomb": width, "asymmetric-coulomb": width})


def _bodies(robot: Robot, rng: np.random.Generator) -> Array:
    """True inertial parameters (n, 10): the description's, each off by some; bodies of our own where it has none."""
    nominal = robot.inertial_vector
    if nominal is not None and (nominal[:, 0] > 0.0).all():
        return nominal * rng.uniform(1.0 - OFF, 1.0 + OFF, (robot.n, 1))
    mass = 4.0 * 0.75 ** np.arange(robot.n) * rng.uniform(1.0 - OFF, 1.0 + OFF, robot.n)
    spread = rng.normal(0.0, 0.08, (robot.n, 3, 5))
    points = np.concatenate([spread, np.ones((robot.n, 1, 5))], axis=1)
    return vector_from_pseudo_inertia(mass[:, None, None] / 5.0 * points @ np.swapaxes(points, 1, 2))


def motion(robot: Robot, rng: np.random.Generator) -> Excitation:
    """A random series within nine tenths of the positions and two thirds of the velocities."""
    low, high = np.array([joint.position_limits for joint in robot.joints]).T
    low, high = np.maximum(low, -np.pi), np.minimum(high, np.pi)
    fastest = np.array([joint.velocity_limit for joint in robot.joints])
    a, b = rng.normal(0.0, 1.0, (2, robot.n, HARMONICS))
    series = Excitation(2.0 * np.pi / SECONDS, a, b, np.zeros(robot.n))
    moved = series.sample(20.0)
    reach = np.ptp(moved.q, axis=0) / 2.0
    scale = np.minimum(0.45 * (high - low) / reach, np.minimum(fastest, 2.2) / 1.5 / np.abs(moved.dq).max(axis=0))
    middle = 0.5 * (moved.q.max(axis=0) + moved.q.min(axis=0)) * scale
    return replace(series, a=a * scale[:, None], b=b * scale[:, None], offset=0.5 * (low + high) - middle)


def recorded(truth: Truth, seed: Sequence[int], noise: float) -> tuple[Recording, Recording]:
    """A recording with noise, and the same without."""
    rng = np.random.default_rng(seed)
    along = motion(truth.model.robot, rng).sample(RATE)
    torque = truth.model.torque(along, truth.theta)
    q = along.q + ENCODER * rng.normal(size=along.q.shape)
    noisy = torque + noise / PASSED * truth.coulomb * rng.normal(size=torque.shape)
    time_ = np.arange(len(q)) / RATE
    names = truth.model.robot.joint_names
    return tuple(
        Recording(
            time_, q, effort=effort, joint_names=names, consecutive=True, source=str(seed), sha256=digest(q, effort)
        )
        for effort in (noisy, torque)
    )  # pyright: ignore[reportReturnType]


def study(truth: Truth, choice: ModelChoice) -> Study:
    """A study that trains on the one recording."""
    return Study(RobotChoice(truth.name), choice, (RecordingChoice(TRAIN),), estimation=EstimationChoice("ridge"))


def unseen_squares(results: Sequence[Result], unseen: Sequence[Recording]) -> tuple[Array, Array]:
    """Squared error of each result against each recording away from standstill (R, K, n), and rows (n,)."""
    sums, rows = [], np.zeros(0)
    for recording in unseen:
        robot, processing = results[0].robot, results[0].study.processing
        observations = joined_observations(process_each([(RecordingChoice(UNSEEN), recording)], processing, robot))
        (run,) = observations.runs
        parts = [
            compare(r.model, torque_parameters(r.estimate.base, r.estimate.fit), run, observations.band)
            for r in results
        ]
        counted = np.all([part.mask for part in parts], axis=0) & (np.abs(run.motion.dq[run.rows]) > MOVING)
        rows = counted.sum(axis=0)
        sums.append([np.sum(part.residual**2 * counted, axis=0) for part in parts])
    return np.swapaxes(np.array(sums), 0, 1), rows


def measure(name: str, seed: int, noise: float) -> dict[str, Any]:
    """RMS of ladder, knowing and plain model on unseen motion, per joint, against noisy and noise-free torque."""
    truth = draw(name, seed)
    train, unseen = recorded(truth, (seed, 2), noise)[0], recorded(truth, (seed, 3), noise)
    given = {TRAIN: train}
    began = time.process_time()
    ladder = identify(study(truth, ModelChoice(automatic=True)), given=given)
    seconds = time.process_time() - began
    knowing = identify(study(truth, truth.choice), given=given)
    plain = identify(study(truth, ModelChoice()), given=given)
    squares, rows = unseen_squares((ladder, knowing, plain), unseen)
    rms = np.sqrt(squares / rows) / truth.coulomb
    return {
        "arm": name,
        "seed": seed,
        "noise": noise,
        "seconds": seconds,
        **{
            way: {"noisy": rms[k, 0].tolist(), "free": rms[k, 1].tolist()}
            for k, way in enumerate(("ladder", "knowing", "plain"))
        },
    }


def pooled(row: dict[str, Any], kind: str, way: str = "ladder") -> float:
    """RMS of all joints, each over its Coulomb friction, over that of who knows the truth."""
    own, knowing = (np.mean(np.square(row[each][kind])) for each in (way, "knowing"))
    return float(np.sqrt(own / knowing))


def each_joint(row: dict[str, Any], kind: str = "noisy") -> Array:
    """RMS of each joint over that of who knows the truth, shape (n,)."""
    return np.array(row["ladder"][kind]) / np.array(row["knowing"][kind])


def line(row: dict[str, Any]) -> str:
    """A row of the table."""
    joints = " ".join(f"{x:.2f}" for x in each_joint(row))
    return (
        f"{row['arm']:<12}{row['seed']:>3}{row['noise']:>7.2f}{pooled(row, 'noisy'):>9.2f}   {joints:<36}"
        f"{pooled(row, 'free'):>6.2f}{pooled(row, 'noisy', 'plain'):>8.1f}{row['seconds']:>7.1f} s"
    )


def summary(rows: Sequence[dict[str, Any]]) -> str:
    """Worst and median of arms and joints."""
    arms, free = (np.array([pooled(row, kind) for row in rows]) for kind in ("noisy", "free"))
    joints = np.concatenate([each_joint(row) for row in rows])
    return "\n".join(
        f"{name}: median {np.median(x):.2f}, worst {x.max():.2f}, above {BOUND}: {(x > BOUND).sum()} of {len(x)}"
        for name, x in (("arms", arms), ("joints", joints), ("arms, noise-free", free))
    )


def main() -> int:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cases", type=int, default=6, help="arms drawn of each kind")
    parser.add_argument("--first", type=int, default=0, help="first seed")
    parser.add_argument("--arm", action="append", choices=ARMS, help="only these arms")
    parser.add_argument("--noise", type=float, action="append", help="torque noise over Coulomb friction")
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    options = parser.parse_args()
    rows: list[dict[str, Any]] = []
    if not options.json:
        print(f"{'arm':<12}seed  noise   pooled   {'each joint':<36}  free   plain")
    for name in options.arm or ARMS:
        for noise in options.noise or (NOISE,):
            for seed in range(options.first, options.first + options.cases):
                rows.append(measure(name, seed, noise))
                if not options.json:
                    print(line(rows[-1]), flush=True)
    print(json.dumps({"results": rows}) if options.json else summary(rows))
    return int(any(pooled(row, "noisy") > BOUND for row in rows))


if __name__ == "__main__":
    sys.exit(main())
