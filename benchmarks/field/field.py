"""Estimators of several tools on the same processed recordings of eight real arms, judged on unseen motion.

    python benchmarks/field/field.py [--data FOLDER] [--arm NAME]… [--peer-python PYTHON] [--out FILE]

Recordings are left out in turn; an arm's only recording is cut into five segments. Positions, velocities,
accelerations and torques are processed once, by armid, and every tool gets the same rows. Peers run in another
interpreter (`--peer-python`), so that their packages do not mix with those of armid. The run writes the results page.
"""

from __future__ import annotations

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("OMP_NUM_THREADS", "1")

import argparse
import subprocess
import sys
import tempfile
import time
import xml.etree.ElementTree as ElementTree
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE.parent))

import corrupted
import friction_arms
from armid.checked_array import Array
from armid.errors import ArmidError
from armid.estimation.catalogue import Estimator
from armid.estimation.estimate_record import Estimate
from armid.estimation.estimators import PhysicallyConsistent, WeightedLeastSquares
from armid.estimation.friction.selection import choose_friction
from armid.estimation.problem import build_problem
from armid.estimation.run_estimator import estimate
from armid.information.hysteresis_states import without_creep
from armid.information.residuals import compare
from armid.measurement.observations import Observations
from armid.model.dynamics_model import DynamicsModel
from armid.study.config import AUTOMATIC_METHOD, EstimationChoice, Study, build_estimator, load_study
from armid.study.recordings.left_out import with_left_out
from armid.study.selection_prior_options import as_chosen
from armid.validation.torque_validation import predict_recording, score
from bands import separated
from corruption_kinds import KINDS

SEGMENTS = 5
"""Segments into which an arm's only recording is cut."""

PEERS = {
    "FIGAROH": ("figaroh_peer.py", "import figaroh, pinocchio", "pip install figaroh"),
    "mujoco.sysid": ("mujoco_peer.py", "import mujoco.sysid", 'pip install "mujoco[sysid]"'),
}
"""Program of each peer, statement that fails where its package is missing, and how to install it."""

SLOW = "mujoco.sysid"
"""Peer that takes some minutes for each arm."""

OWN = ("armid plain", "armid auto", "armid physical")

CORRUPTIONS = (
    "20 torque samples 8 sigma off",
    "gain 1.5 of one torque, second half",
    "torque 50 ms late",
    "torque inverted",
    "two torques exchanged",
    "N·cm",
)
"""Kinds of corruption of the third table."""

CORRUPTED_ARMS = ("kuka_lwr4plus", "ur10e_innopolis", "ur10_unisa")
"""Arms of the third table."""

LIMIT = 1800
"""Longest time of a peer on one problem [s]."""


@dataclass(frozen=True, eq=False)
class Answer:
    """Prediction of one tool on unseen motion.

    Attributes:
        residual: Measured minus predicted torque on the rows of all runs, shape (M, n) [N·m].
        mask: Rows that the tool can predict, shape (M, n).
        covered: Share of rows of each joint inside the 95 % band, shape (n,); `None` without a band.
        seconds: CPU time of the estimate [s].
    """

    residual: Array
    mask: NDArray[np.bool_]
    covered: Array | None
    seconds: float


def study_of(name: str, data: Path | None) -> Study:
    """Study of an arm, with its files in another folder of data if one is given."""
    study = load_study(friction_arms.STUDIES / f"{name}.toml")
    if data is None:
        return study

    def moved(path: str) -> str:
        return str(data.absolute() / path.split("shared/data/")[1])

    recordings = tuple(replace(each, path=moved(each.path)) for each in study.recordings)
    robot = replace(study.robot, description=moved(str(study.robot.description)))
    return replace(study, robot=robot, recordings=recordings)


def bare_urdf(study: Study, joints: Sequence[str]) -> str:
    """Description without shapes, in which every joint that is not identified is fixed."""
    root = ElementTree.parse(Path(study.folder) / str(study.robot.description)).getroot()
    for link in root.iter("link"):
        for shape in [*link.findall("visual"), *link.findall("collision")]:
            link.remove(shape)
    for other in [*root.findall("transmission"), *root.findall("gazebo"), *root.findall("material")]:
        root.remove(other)
    for joint in root.iter("joint"):
        if joint.get("name") not in joints:
            joint.set("type", "fixed")
        for extra in [*joint.findall("mimic"), *joint.findall("origin")[1:]]:
            joint.remove(extra)
    return ElementTree.tostring(root, encoding="unicode")


def armid(
    model: DynamicsModel, method: Estimator, training: Observations, unseen: Observations, apart: bool
) -> Answer:
    """Answer of an estimator of armid."""
    began = time.process_time()
    problem = build_problem(model, training)
    assert problem.base is not None
    own = partial(separated, model, apart)
    first = Estimate(model.robot.name, method.name, (), problem.base, estimate(own(problem), method))
    seconds = time.process_time() - began
    found, _ = with_left_out(first, problem, own, method)
    prediction = predict_recording(model, found, unseen)
    scored = score(model, found, unseen, prediction=prediction)
    residual = np.concatenate([part.residual for part in prediction.runs])
    return Answer(residual, np.concatenate([part.mask for part in prediction.runs]), scored.coverage95, seconds)


def automatic(model: DynamicsModel, training: Observations, unseen: Observations) -> Answer:
    """Answer of armid with `terms = "auto"` and no method named."""
    began = time.process_time()
    selection = choose_friction(model, training)
    bodies = model.robot.inertial_vector
    described = bodies is not None and bool((bodies[:, 0] > 0.0).all())
    method = build_estimator(as_chosen(EstimationChoice(AUTOMATIC_METHOD), selection, described=described))
    seconds = time.process_time() - began
    answer = armid(selection.model, method, without_creep(training), unseen, selection.offset_per_recording)
    return replace(answer, seconds=answer.seconds + seconds)


def exchanged(model: DynamicsModel, observations: Observations, which: str) -> dict[str, Array]:
    """Rows of all runs for a peer: motion, torque in the band and mask."""
    nothing = np.zeros(len(model.parameters))
    parts = [compare(model, nothing, run, observations.band) for run in observations.runs]
    states = {
        name: np.concatenate([getattr(run.motion, name)[run.rows] for run in observations.runs])
        for name in ("q", "dq", "ddq")
    }
    torque, mask = (np.concatenate([getattr(part, name) for part in parts]) for name in ("measured", "mask"))
    return {f"{which}_{name}": values for name, values in (states | {"torque": torque, "mask": mask}).items()}


def peer(
    name: str, python: str, urdf: str, model: DynamicsModel, training: Observations, unseen: Observations
) -> Answer:
    """Answer of another tool, in its own process.

    Raises:
        ArmidError: The tool failed.
    """
    given = exchanged(model, training, "train") | exchanged(model, unseen, "unseen")
    counted = given["train_mask"].any(axis=1)
    given |= {key: values[counted] for key, values in given.items() if key.startswith("train_")}
    noise = np.std(given["train_torque"], axis=0)
    with tempfile.TemporaryDirectory() as folder:
        problem, result = Path(folder) / "problem.npz", Path(folder) / "result.npz"
        joints, gravity = np.array(model.robot.joint_names), np.array(model.robot.gravity)
        np.savez(problem, **given, urdf=urdf, joints=joints, gravity=gravity, noise=noise)  # pyright: ignore[reportArgumentType]
        command = [python, str(HERE / "peers" / PEERS[name][0]), str(problem), str(result)]
        try:
            done = subprocess.run(command, capture_output=True, text=True, timeout=LIMIT, check=False)
        except subprocess.TimeoutExpired as error:
            raise ArmidError(f"{name} took longer than {LIMIT} s.") from error
        if done.returncode or not result.exists():
            raise ArmidError(f"{name} failed: {(done.stderr.strip().splitlines() or ['no message'])[-1]}")
        found = np.load(result)
        residual = given["unseen_torque"] - found["torque"]
        return Answer(residual, given["unseen_mask"].astype(bool), None, float(found["seconds"]))


def measure(name: str, study: Study, peers: dict[str, str]) -> tuple[list[str], dict[str, str]]:
    """Rows of an arm's table, and what failed, by tool."""
    arm = friction_arms.load(name, study)
    urdf = bare_urdf(study, arm.model.robot.joint_names)
    count = SEGMENTS if name in friction_arms.BLOCKS else 0
    tools = [*OWN, *peers]
    squares = {tool: np.zeros(arm.model.n) for tool in tools}
    counted, seconds = np.zeros(arm.model.n), dict.fromkeys(tools, 0.0)
    covered: dict[str, list[Array]] = {tool: [] for tool in tools}
    failed: dict[str, str] = {}
    for training, unseen in friction_arms.left_out(arm, count):
        answers = {
            "armid plain": armid(arm.model, WeightedLeastSquares(), training, unseen, apart=False),
            "armid auto": automatic(arm.model, training, unseen),
            "armid physical": armid(arm.model, PhysicallyConsistent(), training, unseen, apart=False),
        }
        for tool, python in peers.items():
            try:
                answers[tool] = peer(tool, python, urdf, arm.model, training, unseen)
            except ArmidError as error:
                failed[tool] = error.problem
        mask = np.logical_and.reduce([answer.mask for answer in answers.values()])
        counted += mask.sum(axis=0)
        for tool, answer in answers.items():
            squares[tool] += np.sum(answer.residual**2 * mask, axis=0)
            seconds[tool] += answer.seconds
            if answer.covered is not None:
                covered[tool].append(answer.covered)
    shown = [tool for tool in tools if tool not in failed]
    rms = {tool: np.sqrt(squares[tool] / counted) for tool in shown}
    return [row(arm.name, tool, rms, covered[tool], seconds[tool]) for tool in shown], failed


def row(arm: str, tool: str, rms: dict[str, Array], covered: list[Array], seconds: float) -> str:
    """Line of the table."""
    mean = float(np.exp(np.mean(np.log(rms[tool] / rms[OWN[0]]))))
    shares = 100.0 * np.nanmean(covered, axis=0) if covered else None
    band = "-" if shares is None else f"{np.nanmean(shares):.0f} % ({np.nanmin(shares):.0f} %)"
    errors = " ".join(f"{value:.3g}" for value in rms[tool])
    return f"| {arm} | {tool} | {errors} | {mean:.2f} | {band} | {seconds:.2f} |"


def corruption_rows() -> list[str]:
    """Lines of the table of corrupted logs."""
    lines: list[str] = []
    for kind in KINDS:
        for arm in CORRUPTED_ARMS if kind.name in CORRUPTIONS else ():
            found = corrupted.outcome(arm, kind, "alone")
            if found is not None:
                answer = "silent" if found.silent else "named" if found.named else "told, not named"
                lines.append(f"| {kind.name} | {arm} | {found.damage:.2f} | {answer} |")
    return lines


def page(rows: list[str], left_out: dict[str, str], corruptions: list[str]) -> str:
    """Results page in Markdown."""
    head = (HERE / "page.md").read_text(encoding="utf-8")
    missing = "\n".join(f"- {tool}: {why}" for tool, why in left_out.items()) or "- nothing"
    return head.format(rows="\n".join(rows), missing=missing, corruptions="\n".join(corruptions))


def available(python: str) -> tuple[dict[str, str], dict[str, str]]:
    """Peers with their interpreter, and those whose package is missing, with the line that installs it."""
    found: dict[str, str] = {}
    missing: dict[str, str] = {}
    for name, (_, statement, line) in PEERS.items():
        if subprocess.run([python, "-c", statement], capture_output=True, check=False).returncode:
            missing[name] = f"left out, because its package is missing: `{line}`"
        else:
            found[name] = python
    return found, missing


def main() -> int:
    """Measure and write the page."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, help="folder of the recordings; ../shared/data if not given")
    parser.add_argument("--arm", action="append", help="only these arms, by the name of their study")
    parser.add_argument(
        "--peer-python", default=sys.executable, help="interpreter that has the packages of the peers"
    )
    parser.add_argument("--slow", action="append", help="arms on which mujoco.sysid runs; all if not given")
    parser.add_argument("--out", type=Path, help="Markdown page that is written")
    parser.add_argument("--no-corruptions", action="store_true", help="leave the table of corrupted logs out")
    options = parser.parse_args()
    peers, missing = available(options.peer_python)
    rows: list[str] = []
    for name in options.arm or sorted(path.stem for path in friction_arms.STUDIES.glob("*.toml")):
        slow = SLOW in peers and options.slow is not None and name not in options.slow
        own, failed = measure(
            name, study_of(name, options.data), {k: v for k, v in peers.items() if not (slow and k == SLOW)}
        )
        rows += own
        if slow:
            failed |= {SLOW: "left out of this run by the option --slow"}
        missing |= {f"{tool} on {name}": why for tool, why in failed.items()}
        print("\n".join(own), flush=True)
    text = page(rows, missing, [] if options.no_corruptions else corruption_rows())
    if options.out:
        options.out.write_text(text, encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
