"""Prediction intervals and expected errors on logs of simulated arms, with which no constant was chosen.

    python benchmarks/bands_lab.py [ARM …] [--seeds N] [--days N] [--json]

Each arm has friction that the usual terms do not describe (Stribeck effect, hysteresis, asymmetry, ripple and
dependence on load). From one day to the next, the friction of each joint changes by a lognormal factor, and each
torque has another offset. One recording, or several, train a model as a study does, with the terms of a study that
names none (*plain*) and with `terms = "auto"`; another day's recording, with another motion, judges. Printed are the
share of its rows inside the 95 % prediction interval, of all joints and of the worst; the median half width over the
one that an oracle would need; and the joints whose RMS error lies inside the 90 % interval that was stated before.
"""

from __future__ import annotations

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("OMP_NUM_THREADS", "1")

import argparse
import json
import sys
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from armid.checked_array import Array
from armid.errors import ArmidError
from armid.lab.known_arms import KnownArm, truth_of, with_effects
from armid.lab.options import LabOptions
from armid.lab.sensors import Sensing, SensorChannel
from armid.lab.simulation import simulate
from armid.measurement.recording import Recording
from armid.robot import load_robot
from armid.study.config import AUTOMATIC_METHOD, EstimationChoice, ModelChoice, RecordingChoice, RobotChoice, Study
from armid.study.identify import identify
from armid.study.recordings.processed import process_each
from armid.study.recordings.reading import read_choice
from armid.validation.torque_validation import predict_recording
from sound import NOISE, RATE, ROOT, motion

ARMS = {
    **{name: name for name in ("iiwa14-r820", "panda", "ur5e", "ur10e")},
    "gantry": str(ROOT / "tests/tables/gantry.toml"),
    "scara": str(ROOT / "tests/tables/scara.toml"),
}

EFFECTS = ("rotor", "stribeck", "hysteresis", "asymmetric", "ripple", "load")
"""Effects of `armid.lab` that each arm has."""

FRICTION_CHANGE = 0.12
"""Standard deviation of the logarithm of a joint's friction from one day to the next, as by some 10 to 15 K."""

OFFSET = 0.01
"""Standard deviation of the offset of a torque from one day to the next, in shares of the range of the torque."""


@dataclass(frozen=True, eq=False)
class Judged:
    """Errors on the recording of another day, per joint.

    Attributes:
        inside: Share of the rows inside the 95 % prediction interval, shape (n,).
        width: Median half width over that of an oracle, shape (n,).
        kept: True where the RMS error lies in the 90 % interval that was stated before, shape (n,).
        verdict: Verdict of the validation.
    """

    inside: Array
    width: Array
    kept: Array
    verdict: str


def day(arm: KnownArm, seed: int, name: str) -> Recording:
    """A recording of one day."""
    rng = np.random.default_rng((71, seed))
    n, friction = arm.robot.n, arm.friction
    factor = np.exp(FRICTION_CHANGE * rng.standard_normal(n))
    changed = replace(friction, coulomb=factor * friction.coulomb, viscous=factor * friction.viscous)
    effort = np.array([joint.effort_limit for joint in arm.robot.joints])
    noise = NOISE * min((limit for limit in effort if 0.0 < limit < np.inf), default=60.0)
    options = LabOptions(repetitions=2, sensing=Sensing(rate=RATE, effort=SensorChannel(noise=noise)))
    log = simulate(replace(arm, friction=changed), motion(arm.robot, seed), options, seed=seed).recording
    assert log.effort is not None
    offset = OFFSET * np.ptp(log.effort, axis=0) * rng.standard_normal(n)
    return replace(log, effort=log.effort + offset, source=name, sha256="")


def judged(name: str, recordings: dict[str, Recording], *, automatic: bool) -> Judged:
    """A study of all recordings but the last, which judges it."""
    *training, last = recordings
    choices = tuple(RecordingChoice(each) for each in training)
    method = EstimationChoice(AUTOMATIC_METHOD) if automatic else EstimationChoice()
    study = Study(RobotChoice(ARMS[name]), ModelChoice(automatic=automatic), choices, estimation=method)
    result = identify(study, given=recordings)
    expected = result.validation.left_out.expected if result.validation.left_out else None
    robot = result.model.robot
    recording = read_choice(RecordingChoice(last), ".", robot, recordings)[0]
    (unseen,) = process_each([(RecordingChoice(last), recording)], result.study.processing, robot)
    prediction = predict_recording(result.model, result.estimate, unseen.observations)
    residual = [np.where(run.mask, run.residual, np.nan) for run in prediction.runs]
    error = np.concatenate([part[:: prediction.every] for part in residual])
    half = np.where(np.isnan(error), np.nan, prediction.half_widths)
    inside = np.where(np.isnan(error), np.nan, np.abs(error) <= half)
    rms = np.sqrt(np.nanmean(np.concatenate(residual) ** 2, axis=0))
    kept = np.zeros(robot.n, dtype=np.bool_) if expected is None else (expected.low <= rms) & (rms <= expected.high)
    oracle = np.nanquantile(np.abs(error), 0.95, axis=0)
    return Judged(np.nanmean(inside, axis=0), np.nanmedian(half, axis=0) / oracle, kept, result.validation.verdict)


def measure(name: str, way: str, seeds: int, days: int) -> dict[str, Any]:
    """Coverage and width of an arm over all seeds."""
    arm = with_effects(truth_of(load_robot(ARMS[name])), EFFECTS)
    found: list[Judged] = []
    failed = 0
    for seed in range(seeds):
        recordings = {f"day{k}": day(arm, 100 * seed + k, f"day{k}") for k in range(days + 1)}
        try:
            found.append(judged(name, recordings, automatic=way == "auto"))
        except ArmidError as error:
            print(f"{name} {way} {seed}: {error}", file=sys.stderr)
            failed += 1
    inside, width, kept = (np.array([getattr(each, of) for each in found]) for of in ("inside", "width", "kept"))
    return {
        "arm": name,
        "way": way,
        "days": days,
        "failed": failed,
        "inside": float(inside.mean()),
        "joints": inside.mean(axis=0).tolist(),
        "cells_below_85": int((inside < 0.85).sum()),
        "width": float(np.median(width)),
        "stated": [int(kept.sum()), kept.size],
        "verdicts": [each.verdict for each in found],
    }


def main() -> int:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("arms", nargs="*", help=", ".join(ARMS))
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--days", type=int, nargs="+", default=[1, 3], help="numbers of recordings that train")
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    options = parser.parse_args()
    rows: list[dict[str, Any]] = []
    for name in options.arms or ARMS:
        for days in options.days:
            for way in ("plain", "auto"):
                rows.append(row := measure(name, way, options.seeds, days))
                kept, all_ = row["stated"]
                if not options.json:
                    print(
                        f"{name:<12}{way:<6}{days} days {100 * row['inside']:6.1f} % inside, worst joint "
                        f"{100 * min(row['joints']):5.1f} %, {row['cells_below_85']} of {all_} below 85 %, width "
                        f"{row['width']:4.2f} x oracle, expected error kept {kept} of {all_}",
                        flush=True,
                    )
    if options.json:
        print(json.dumps({"results": rows}))
    return 0


if __name__ == "__main__":
    sys.exit(main())
