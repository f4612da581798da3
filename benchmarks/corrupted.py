"""Findings and damage of an identification from real recordings that were corrupted.

    python benchmarks/corrupted.py [--arms NAME …] [--kinds TEXT …] [--settings …] [--verbose] [--json FILE]

Each kind of `corruption_kinds.py` is applied to a recording of five arms of ../shared/data, which trains *alone*, or
*beside* a clean one; in *both*, the validation recording is corrupted in the same way. Damage is the error on a clean
recording or far block that no estimate has seen, each joint relative to its error after clean training, root mean
square over the joints. What is new, compared with the same study of clean recordings, counts: findings of severity
warning or error, and a verdict that is no longer `pass`. A corruption is *named* by a finding with one of its codes
that names its joint.
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
import zlib
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np

from armid.checked_array import Array
from armid.errors import ArmidError, Finding, RecordingError
from armid.estimation.estimate_record import torque_parameters
from armid.information.residuals import compare
from armid.measurement.readers import load_recording
from armid.measurement.recording import Recording
from armid.robot import Robot
from armid.study.config import RecordingChoice, Study, load_choice, load_study
from armid.study.identify import Result, identify
from armid.study.recordings.data_split import cut_recording
from armid.study.recordings.processed import process_each
from armid.study.recordings.reading import read_choice
from corruption_kinds import KINDS, Kind
from corruption_scene import Scene
from fifth_kinds import FIFTH
from fourth_kinds import FOURTH
from further_kinds import FURTHER
from later_kinds import LATER
from seventh_kinds import SEVENTH
from sixth_kinds import SIXTH

STUDIES = Path(__file__).parents[1] / "tests" / "real" / "studies"

SETTINGS = ("alone", "beside", "both")

DAMAGE = 1.3
"""Damage from which a corruption must not be silent."""

Source = tuple[str, tuple[float, float]]
"""Part of the name of a recording's file, and the part of the recording."""

ARMS: dict[str, tuple[Source, Source, Source]] = {
    "kuka_lwr4plus": (("s_3", (0.0, 1.0)), ("s_1", (0.0, 0.5)), ("s_1", (0.5, 1.0))),
    "kinova_gen3_raptor": (("traj_1", (0.0, 1.0)), ("traj_3", (0.0, 1.0)), ("traj_5", (0.0, 1.0))),
    "ur10e_innopolis": (("30sec", (0.0, 1.0)), ("40sec", (0.0, 1.0)), ("12-50sec", (0.0, 1.0))),
    "franka_panda_gaz": (("first70", (0.0, 0.5)), ("first70", (0.5, 0.75)), ("first70", (0.75, 1.0))),
    "ur10_unisa": (("exciting", (0.0, 0.5)), ("exciting", (0.5, 0.75)), ("exciting", (0.75, 1.0))),
    "kuka_iiwa14_lasa": (("samples", (0.0, 0.5)), ("samples", (0.5, 0.75)), ("samples", (0.75, 1.0))),
    "kuka_lbr_med7": (("ments.p", (0.0, 0.6)), ("1_dgr", (0.0, 1.0)), ("ments.p", (0.6, 1.0))),
}
"""Recordings of each arm: the one that is corrupted, a clean one beside it, and the one that judges."""

USUAL = tuple(ARMS)[:5]
"""Arms of a run that names none."""


@dataclass(frozen=True, eq=False)
class Case:
    """An arm with its three recordings as logged."""

    name: str
    study: Study
    robot: Robot
    choices: tuple[RecordingChoice, RecordingChoice, RecordingChoice]
    raw: tuple[Recording, Recording, Recording]


@dataclass(frozen=True, slots=True)
class Outcome:
    """Answer of one identification to a corruption.

    Attributes:
        arm: Arm.
        setting: One of `SETTINGS`.
        family: Family of the corruption.
        kind: Its name.
        joint: Joint that was corrupted; empty if it is not about one.
        damage: Error on clean motion over that of clean training; infinite where nothing was estimated.
        told: New findings of severity warning or error, `code (channel)`.
        verdict: Verdict, `refused` where the identification ended with an error.
        silent: True if nothing is told and the verdict is that of the clean study.
        named: True if a finding names the corruption.
        seconds: CPU time of the identification [s].
    """

    arm: str
    setting: str
    family: str
    kind: str
    joint: str
    damage: float
    told: tuple[str, ...]
    verdict: str
    silent: bool
    named: bool
    seconds: float


@cache
def case_of(name: str) -> Case:
    """An arm by its study, with the recordings of `ARMS`."""
    study = load_study(STUDIES / f"{name}.toml")
    robot = load_choice(study.robot, study.folder)
    choices, raws = [], []
    for (part_of_name, part), path in zip(ARMS[name], ("train", "beside", "judge"), strict=True):
        own = next(each for each in study.recordings if part_of_name in each.path)
        raw = load_recording(Path(study.folder) / own.path, own.reading, robot)
        raws.append(replace(cut_recording(raw, part), source=path, sha256=""))
        choices.append(RecordingChoice(path, "train", own.reading))
    return Case(name, study, robot, tuple(choices), tuple(raws))  # pyright: ignore[reportArgumentType]


def identified(case: Case, train: Recording, judge: Recording, *, beside: bool) -> Result:
    """A study whose training and validation recordings are given."""
    own, other, last = case.choices
    recordings = (own, *((other,) if beside else ()), replace(last, role="validate"))
    given = {"train": train, "beside": case.raw[1], "judge": judge}
    return identify(replace(case.study, recordings=recordings), given=given)


@cache
def clean_result(name: str, *, beside: bool) -> tuple[Result, Array]:
    """The study of clean recordings and its error on the one that judges, shape (n,)."""
    case = case_of(name)
    result = identified(case, case.raw[0], case.raw[2], beside=beside)
    return result, clean_error(case, result)


def clean_error(case: Case, result: Result) -> Array:
    """RMS error of each joint on the clean recording that judges, shape (n,) [N·m]."""
    choice = replace(case.choices[2], role="validate")
    recording = read_choice(choice, case.study.folder, case.robot, {"judge": case.raw[2]})[0]
    (judge,) = process_each([(choice, recording)], result.study.processing, case.robot)
    theta = torque_parameters(result.estimate.base, result.estimate.fit)
    parts = [compare(result.model, theta, run, judge.observations.band) for run in judge.observations.runs]
    square = np.sum([np.where(part.mask, part.residual**2, 0.0).sum(axis=0) for part in parts], axis=0)
    return np.sqrt(square / np.sum([part.mask.sum(axis=0) for part in parts], axis=0))


def scene_of(case: Case, kind: Kind, which: int) -> Scene:
    """A recording with what its corruption needs; the joints are the same for every recording of an arm."""
    rng = np.random.default_rng(zlib.crc32(f"{case.name} {kind.name}".encode()))
    joint, other = rng.choice(case.robot.n, 2, replace=False)
    result = clean_result(case.name, beside=False)[0]
    theta = torque_parameters(result.estimate.base, result.estimate.fit)
    return Scene(case.raw[which], case.choices[which].reading, result.model, theta, int(joint), int(other), rng)


def outcome(name: str, kind: Kind, setting: str) -> Outcome | None:
    """One corruption of one arm; `None` where it changes nothing in this log, as the velocities of one without."""
    case = case_of(name)
    scene = scene_of(case, kind, 0)
    train = kind.change(scene)
    if same(train, case.raw[0]):
        return None
    judge = kind.change(scene_of(case, kind, 2)) if setting == "both" else case.raw[2]
    clean, usual = clean_result(name, beside=setting == "beside")
    before = {(f.code, f.channel) for f in serious(clean.estimate.findings)}
    began = time.process_time()
    try:
        result = identified(case, train, judge, beside=setting == "beside")
    except ArmidError as error:
        seconds = time.process_time() - began
        found, verdict, damage = causes_of(error), "refused", np.inf
    else:
        seconds = time.process_time() - began
        found = [f for f in serious(result.estimate.findings) if (f.code, f.channel) not in before]
        verdict = result.validation.verdict
        damage = float(np.sqrt(np.mean((clean_error(case, result) / usual) ** 2)))
    joints = [case.robot.joint_names[j] for j in (scene.joint, scene.other)]
    right = [f for f in found if f.code in kind.codes and (not kind.one_joint or names_one(f, joints))]
    silent = not found and verdict == clean.validation.verdict
    told = tuple(f"{f.code} {f.severity}" + (f" ({f.channel})" if f.channel else "") for f in found)
    joint = joints[0] if kind.one_joint else ""
    return Outcome(
        name, setting, kind.family, kind.name, joint, damage, told, verdict, silent, bool(right), round(seconds, 3)
    )


def causes_of(error: ArmidError) -> list[Finding]:
    """Findings of an error: its own code, and the codes in brackets that its text names as causes."""
    codes = [error.code] if isinstance(error, RecordingError) else re.findall(r"\[([a-z-]+)\]", str(error))
    return [Finding(code, "error", "", str(error), "") for code in codes or [""]]


def same(one: Recording, other: Recording) -> bool:
    """True if two recordings have the same numbers."""
    pairs = [(getattr(one, name), getattr(other, name)) for name in ("time", "q", "dq", "ddq", "effort")]
    return all(a is b or (a is not None and b is not None and np.array_equal(a, b)) for a, b in pairs)


def serious(findings: Sequence[Finding]) -> list[Finding]:
    """Warnings and errors."""
    return [f for f in findings if f.severity != "info"]


def names_one(finding: Finding, joints: Sequence[str]) -> bool:
    """True if a finding names one of two joints."""
    return any(joint in finding.channel.split(", ") or joint in finding.evidence for joint in joints)


def table(outcomes: Sequence[Outcome], key: str) -> list[str]:
    """Lines of a table by family, kind, arm or setting."""
    lines = [f"{key:48s}{'all':>6s}{'harm':>6s}{'silent':>12s}{'named':>12s}{'silent, no harm':>17s}"]
    groups = list(dict.fromkeys(getattr(o, key) for o in outcomes))
    for group in [*groups, "all"]:
        own = [o for o in outcomes if group == "all" or getattr(o, key) == group]
        harm = [o for o in own if o.damage > DAMAGE]
        silent, named = sum(o.silent for o in harm), sum(o.named for o in harm)
        rest = sum(o.silent for o in own) - silent
        share = [f"{count} {count / max(len(harm), 1):5.0%}" for count in (silent, named)]
        lines.append(f"{group:48s}{len(own):6d}{len(harm):6d}{share[0]:>12s}{share[1]:>12s}{rest:17d}")
    return lines


def main() -> None:
    """Corrupt, identify and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--arms", nargs="+", choices=tuple(ARMS), default=USUAL)
    parser.add_argument("--kinds", nargs="+", default=("",), help="parts of families or names of kinds")
    parser.add_argument("--settings", nargs="+", choices=SETTINGS, default=SETTINGS)
    parser.add_argument("--verbose", action="store_true", help="a line for each identification")
    parser.add_argument("--json", type=Path, help="file that is written")
    options = parser.parse_args()
    every = (*KINDS, *FURTHER, *LATER, *FOURTH, *FIFTH, *SIXTH, *SEVENTH)
    kinds = [kind for kind in every if any(text in f"{kind.family}: {kind.name}" for text in options.kinds)]
    outcomes: list[Outcome] = []
    for name in options.arms:
        for kind in kinds:
            for setting in options.settings:
                found = outcome(name, kind, setting)
                if found is None:
                    continue
                outcomes.append(found)
                if options.verbose:
                    show(found)
    for key in ("family", "arm", "setting", *(("kind",) if options.verbose else ())):
        print("\n".join(table(outcomes, key)), end="\n\n")
    print(f"{len(kinds)} kinds, {np.mean([o.seconds for o in outcomes]):.2f} s of CPU for each identification")
    if options.json:
        options.json.write_text(json.dumps([asdict(each) for each in outcomes], indent=1))


def show(found: Outcome) -> None:
    """A line for an identification."""
    mark = "SILENT" if found.silent else "named " if found.named else "told  "
    where = f"{found.kind}{f' [{found.joint}]' if found.joint else ''}"
    told = "; ".join(dict.fromkeys(found.told))
    print(
        f"{found.damage:9.2f} {mark} {found.arm:19s}{found.setting:7s}{where:60s} {found.verdict:8s}{told}",
        flush=True,
    )


if __name__ == "__main__":
    if not STUDIES.is_dir():
        sys.exit(f"{STUDIES} is missing")
    main()
