"""Pinocchio's regressor in a C++ loop, compiled here from the headers that its wheel brings."""

from __future__ import annotations

import importlib.util
import os
import shutil
import subprocess
import tempfile
from pathlib import Path

import numpy as np

from armid.checked_array import Array
from armid.kernel import Tree

__all__ = ["PeerMissingError", "build_loop", "run_loop"]

SOURCE = Path(__file__).with_name("pinocchio_loop.cpp")

LIMITS = ("MPL_LIMIT_LIST_SIZE=30", "MPL_LIMIT_VECTOR_SIZE=30", "MPL_CFG_NO_PREPROCESSED_HEADERS")
ARITY = "FUSION_INVOKE_MAX_ARITY=10"
"""Boost's lists are too short for Pinocchio's joints unless told otherwise."""


class PeerMissingError(Exception):
    """The peer cannot be measured here; the message says what is missing."""


def _prefix() -> Path:
    """Tell where the wheels of Pinocchio and Eigen put their headers."""
    found = importlib.util.find_spec("cmeel")
    if found is None or found.origin is None:
        raise PeerMissingError("Pinocchio is not installed as a wheel.")
    return Path(found.origin).parents[1] / "cmeel.prefix"


def _eigen(prefix: Path) -> Path:
    for folder in (os.environ.get("EIGEN_INCLUDE", ""), prefix / "include/eigen3", "/usr/include/eigen3"):
        if folder and (Path(folder) / "Eigen/Core").exists():
            return Path(folder)
    raise PeerMissingError("Eigen's headers are missing: pip install cmeel-eigen, or set EIGEN_INCLUDE.")


def build_loop(folder: Path) -> Path:
    """Compile the loop for this machine, about a minute, unless that has been done in `folder` before.

    Raises:
        PeerMissingError: No compiler or headers, or they do not fit.
    """
    compiler = shutil.which(os.environ.get("CXX", "g++"))
    if compiler is None:
        raise PeerMissingError("There is no C++ compiler.")
    program = folder / "pinocchio_loop"
    if program.exists() and program.stat().st_mtime > SOURCE.stat().st_mtime:
        return program
    prefix = _prefix()
    folder.mkdir(parents=True, exist_ok=True)
    command = [compiler, "-std=c++17", "-O3", "-march=native", "-DNDEBUG"]
    command += [f"-DBOOST_{define}" for define in (*LIMITS, ARITY)]
    command += [f"-I{prefix / 'include'}", f"-I{_eigen(prefix)}", str(SOURCE), "-o", str(program)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode:
        errors = [line for line in done.stderr.splitlines() if "error" in line]
        raise PeerMissingError(f"{SOURCE.name} does not compile: {(errors or ['?'])[0]:.200}")
    return program


def run_loop(program: Path, tree: Tree, state: tuple[Array, Array, Array], repetitions: int) -> tuple[Array, Array]:
    """CPU time of each repetition over all samples [s], and the regressor (n, 10 n) of the last sample."""
    n, samples = tree.n, len(state[0])
    placements = [np.concatenate([tree.rotation[i].ravel(), tree.translation[i]]) for i in range(n)]
    numbers = [np.array([float(n)]), tree.gravity, *placements, np.array([samples, repetitions], dtype=float)]
    numbers += [x.ravel() for x in state]
    with tempfile.TemporaryFile() as stream:
        stream.write(np.concatenate(numbers).tobytes())
        stream.seek(0)
        done = subprocess.run([str(program)], stdin=stream, capture_output=True, check=True)
    out = np.frombuffer(done.stdout)
    return out[:repetitions], out[repetitions:].reshape(10 * n, n).T
