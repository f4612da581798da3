"""Calls of a generated ROS 2 plugin: `python benchmarks/ros2.py [--robot NAME] [--json]`.

The package is built with -O2 against the stand-ins of ROS 2 of the tests. Told are the time of a call of getTorques,
which allocates its result, and of computeTorques, each the best of 20 repetitions of 1000 calls.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "support"))

from armid.codegen.generation import generate
from armid.codegen.language_input import identifier
from armid.model.base_parameters import find_base_parameters
from armid.model.dynamics_model import DynamicsModel
from armid.model.terms import Coulomb, Offset, RigidBody, RotorInertia, Viscous
from armid.robot import load_robot
from coded import write_files
from ros2_packages import MISSING, Package


def main() -> int:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--robot", default="iiwa14-r820")
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    options = parser.parse_args()
    if MISSING:
        print("gcc, g++ or the headers of Eigen are missing.", file=sys.stderr)
        return 1
    terms = (RigidBody(), Viscous(), Coulomb(0.02), Offset(), RotorInertia())
    model = DynamicsModel(load_robot(options.robot), terms)
    base, rng = find_base_parameters(model), np.random.default_rng(0)
    with tempfile.TemporaryDirectory() as folder:
        write_files(generate(model, base, rng.normal(size=base.count), "ros2"), Path(folder))
        package = Package(Path(folder), identifier(model.robot.name), model.n)
        package.build("-O2")
        _, calls = package.evaluate(rng.uniform(-2.0, 2.0, (4, 3, model.n)), package.parameters())
    record = {"robot": options.robot, **{name: calls[f"{name}_ns"] for name in ("getTorques", "computeTorques")}}
    print(json.dumps(record) if options.json else f"{options.robot}: ns a call: {record}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
