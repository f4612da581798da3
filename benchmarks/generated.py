"""Generated C beside Pinocchio's C++: `python benchmarks/generated.py [--robot NAME] [--json] [--build FOLDER]`."""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

import peers
from armid.codegen.functions import make_programs
from armid.codegen.generation import generate
from armid.model.base_parameters import find_base_parameters
from armid.model.dynamics_model import DynamicsModel
from armid.model.terms import RigidBody
from armid.robot import load_robot

SOURCE = Path(__file__).with_name("pinocchio_rnea.cpp")
SAMPLES, REPETITIONS = 2000, 40


def build(folder: Path, model: DynamicsModel, values: np.ndarray) -> Path:
    """Compile the generated C with -O2 and Pinocchio's loop with all that the machine has, about a minute."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, text in generate(model, find_base_parameters(model), values, "c", name="arm").items():
        (folder / name).write_text(text)
    subprocess.run(["gcc", "-std=c99", "-O2", "-c", "arm.c", "-o", "arm.o"], cwd=folder, check=True)
    program, loop = folder / "pinocchio_rnea", folder / "loop.o"
    prefix = peers._prefix()
    if not loop.exists() or loop.stat().st_mtime < SOURCE.stat().st_mtime:
        command = ["g++", "-std=c++17", "-O3", "-march=native", "-DNDEBUG", "-w", f"-I{folder}"]
        command += [f"-DBOOST_{define}" for define in (*peers.LIMITS, peers.ARITY)]
        command += [f"-I{prefix / 'include'}", f"-I{peers._eigen(prefix)}", "-c", str(SOURCE), "-o", str(loop)]
        subprocess.run(command, check=True)
    subprocess.run(["g++", str(loop), str(folder / "arm.o"), "-o", str(program)], check=True)
    return program


def measure(program: Path, model: DynamicsModel, inertial: np.ndarray) -> dict[str, float]:
    """Nanoseconds a call of each, the median over repetitions of their ratio, and how far they differ."""
    tree, rng = model.tree, np.random.default_rng(0)
    joints = [np.concatenate([tree.rotation[i].ravel(), tree.translation[i], inertial[i]]) for i in range(tree.n)]
    states = [rng.uniform(-2.0, 2.0, (SAMPLES, tree.n)).ravel() for _ in range(3)]
    numbers = [
        np.array([float(tree.n)]),
        tree.gravity,
        *joints,
        np.array([SAMPLES, REPETITIONS], dtype=float),
        *states,
    ]
    with tempfile.TemporaryFile() as stream:
        stream.write(np.concatenate(numbers).tobytes())
        stream.seek(0)
        done = subprocess.run([str(program)], stdin=stream, capture_output=True, check=True)
    out = np.frombuffer(done.stdout)
    times = out[:-2].reshape(-1, 2) / SAMPLES * 1e9
    return {
        "generated_nanoseconds": float(np.median(times[:, 0])),
        "rnea_nanoseconds": float(np.median(times[:, 1])),
        "ratio": float(np.median(times[:, 1] / times[:, 0])),
        "difference": float(out[-2] / out[-1]),
    }


def main() -> int:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--robot", default="iiwa14-r820", help="a serial arm with all axes along z")
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    parser.add_argument("--build", type=Path, default=Path("build/benchmarks/generated"), help="where it is built")
    options = parser.parse_args()
    model = DynamicsModel(load_robot(options.robot), (RigidBody(),))
    base, rng = find_base_parameters(model), np.random.default_rng(0)
    factor = rng.normal(size=(model.n, 4, 4))
    J = factor @ np.swapaxes(factor, 1, 2)  # pseudo-inertias of bodies that can exist
    trace = J[:, 0, 0] + J[:, 1, 1] + J[:, 2, 2]
    inertial = np.column_stack([
        J[:, 3, 3], J[:, 0, 3], J[:, 1, 3], J[:, 2, 3],
        trace - J[:, 0, 0], -J[:, 0, 1], trace - J[:, 1, 1], -J[:, 0, 2], -J[:, 1, 2], trace - J[:, 2, 2],
    ])  # fmt: skip
    found = measure(build(options.build.resolve(), model, base.values_of(inertial.ravel())), model, inertial)
    (program,) = make_programs(model, base, ["inverse_dynamics"])
    record = {"robot": options.robot, **found, "operations": dict(program.operations)}
    if options.json:
        print(json.dumps(record))
        return 0
    print(
        f"{options.robot}: {record['generated_nanoseconds']:.0f} ns a call, rnea {record['rnea_nanoseconds']:.0f} ns,"
    )
    print(f"x {record['ratio']:.2f}; difference {record['difference']:.1e}; operations {record['operations']}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
