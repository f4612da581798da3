"""Build and evaluation of generated ROS 2 packages against stand-ins of ROS 2."""

from __future__ import annotations

import importlib.util
import json
import subprocess
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from armid.checked_array import Array
from coded import CC, CXX, STRICT

STAND_INS = Path(__file__).parents[1] / "data" / "ros2"


def eigen_folder() -> Path | None:
    """Folder that contains `eigen3/Eigen/Core`: of the machine, or of the wheels of CasADi or Eigen."""
    folders = [Path("/usr/include")]
    for package, inside in (("casadi", "include"), ("cmeel", "../cmeel.prefix/include")):
        found = importlib.util.find_spec(package)
        if found is not None and found.origin is not None:
            folders.append((Path(found.origin).parent / inside).resolve())
    return next((folder for folder in folders if (folder / "eigen3" / "Eigen" / "Core").is_file()), None)


EIGEN = eigen_folder()
MISSING = CC is None or CXX is None or EIGEN is None


@dataclass(frozen=True)
class Package:
    """A package in a folder, and the name of the arm in its code."""

    folder: Path
    arm: str
    joints: int

    @property
    def name(self) -> str:
        return f"{self.arm}_inverse_dynamics_solver"

    def parameters(self) -> dict[str, Any]:
        """Parameters of the node in the YAML file, under the namespace of the file."""
        content = yaml.safe_load((self.folder / "config" / "parameters.yaml").read_text(encoding="utf-8"))
        return {f"ids.{key}": value for key, value in content["/**"]["ros__parameters"]["ids"].items()}

    def build(self, optimisation: str = "-O1") -> None:
        """Compile the package with the program that evaluates it; warnings are errors."""
        includes = [f"-isystem{EIGEN}", f"-I{STAND_INS}", "-Iinclude"]
        header = f'-DCLASS_HEADER="{self.name}/solver.hpp"'
        command = [str(CXX), "-std=c++17", optimisation, *STRICT, *includes, f"-DCLASS={self.name}::Solver", header]
        c = [str(CC), "-std=c99", optimisation, *STRICT, f"-Iinclude/{self.name}", "-c", f"src/{self.arm}.c"]
        subprocess.run(c, cwd=self.folder, check=True)
        sources = ["src/solver.cpp", str(STAND_INS / "evaluate.cpp"), f"{self.arm}.o"]
        subprocess.run([*command, *sources, "-o", "evaluate"], cwd=self.folder, check=True)

    def run(self, states: Array, parameters: Mapping[str, Any] | None) -> subprocess.CompletedProcess[str]:
        """Run the program with parameters of the node along states (N, 3, n); `None` for no node."""
        states.tofile(self.folder / "states.bin")
        if parameters is not None:
            (self.folder / "parameters.txt").write_text("\n".join(_line(*each) for each in parameters.items()) + "\n")
        given = "none" if parameters is None else "parameters.txt"
        command = ["./evaluate", f"{self.name}::Solver", str(self.joints), given, "states.bin", "results.bin"]
        return subprocess.run(command, cwd=self.folder, capture_output=True, text=True, check=False)

    def evaluate(
        self, states: Array, parameters: Mapping[str, Any] | None
    ) -> tuple[dict[str, Array], dict[str, float]]:
        """Results along states (N, 3, n), and allocations and times of calls."""
        done = self.run(states, parameters)
        assert done.returncode == 0, done.stderr
        n = self.joints
        shapes = {"M": (n, n), "coriolis": (n,), "gravity": (n,), "friction": (n,), "torque": (n,)}
        shapes |= {f"dynamic parameters {name}": shapes[name] for name in ("M", "coriolis", "gravity")}
        out = np.fromfile(self.folder / "results.bin").reshape(len(states), -1)
        ends = np.cumsum([0, *(int(np.prod(shape)) for shape in shapes.values())])
        parts = zip(shapes.items(), ends[:-1], ends[1:], strict=True)
        return {name: out[:, a:b].reshape(-1, *shape) for (name, shape), a, b in parts}, json.loads(done.stdout)


def _line(name: str, value: Any) -> str:
    """A parameter as the program reads it: its type is that of the value in the YAML file."""
    if isinstance(value, list):
        assert all(isinstance(x, float) for x in value)
        return f"{name} double_array {' '.join(map(repr, value))}"
    if isinstance(value, bool):
        return f"{name} bool {str(value).lower()}"
    assert isinstance(value, str)
    return f"{name} string {value}"
