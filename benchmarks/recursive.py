"""The recursive estimate beside plain recursive least squares in NumPy: `python benchmarks/recursive.py [--json]`.

The iiwa 14 with 57 base parameters, 1 kHz, blocks of a second, CPU time of one thread for each sample. The peer is
given the regressor's rows for nothing and updates covariance and estimate sample by sample, seven rows at a time.
"""

from __future__ import annotations

import argparse
import json
import sys
import time

import numpy as np

from armid.checked_array import Array
from armid.estimation.recursive.recursive_estimate import ForgettingOptions, begin, fit, update
from armid.excitation.thesis_plans import builtin_plan
from armid.information.accumulate import accumulate_information
from armid.lab.inverse_dynamics_recording import thesis_truth
from armid.measurement.low_pass_band import Band
from armid.measurement.observations import Observations, ObservedRun
from armid.model.base_parameters import find_base_parameters
from armid.model.dynamics_model import DynamicsModel
from armid.model.terms import Coulomb, RigidBody, Viscous
from armid.robot import load_robot

RATE, SECONDS, MEMORY = 1000, 20, 30.0


def peer(rows: Array, torque: Array, left: float) -> Array:
    """Exponentially forgetting least squares, P and x at every sample."""
    b = rows.shape[2]
    P, x = 1e3 * np.eye(b), np.zeros(b)
    for Y, y in zip(rows, torque, strict=True):
        PY = P @ Y.T
        gain = np.linalg.solve(left * np.eye(len(y)) + Y @ PY, PY.T).T
        x = x + gain @ (y - Y @ x)
        P = (P - gain @ PY.T) / left
        P = 0.5 * (P + P.T)  # else rounding makes it indefinite within seconds
    return x


def main() -> int:
    """Measure both in one run."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    options = parser.parse_args()
    model = DynamicsModel(load_robot("iiwa14-r820"), (RigidBody(), Viscous(), Coulomb()))
    base = find_base_parameters(model)
    motion = builtin_plan("thesis-a1").stretched(SECONDS).sample(RATE)
    torque = model.torque(motion, thesis_truth(model))
    torque += 0.3 * np.random.default_rng(1).standard_normal(torque.shape)
    blocks = []
    for k in range(SECONDS):
        part = motion[slice(k * RATE, (k + 1) * RATE)]
        mask, one = np.ones((RATE, model.n), dtype=np.bool_), np.zeros(RATE, dtype=np.int64)
        run = ObservedRun(part, torque[k * RATE : (k + 1) * RATE], RATE, 1, 0, mask, one)
        blocks.append(Observations((run,), Band()))
    began = time.process_time()
    state = begin(accumulate_information(model, base, blocks[0]), ForgettingOptions(MEMORY))
    for observations in blocks:
        state = update(state, accumulate_information(model, base, observations), 1.0)
    fit(state)
    mine = (time.process_time() - began) / motion.samples
    few = slice(0, 4 * RATE)
    rows = model.regressor(motion[few])[:, :, base.kept]
    began = time.process_time()
    peer(rows, torque[few], float(np.exp(-1.0 / RATE / MEMORY)))
    theirs = (time.process_time() - began) / len(rows)
    found = {"armid_us": 1e6 * mine, "peer_us": 1e6 * theirs, "ratio": theirs / mine, "of_real_time": mine * RATE}
    if options.json:
        print(json.dumps(found))
    else:
        print(
            f"{1e6 * mine:.1f} µs a sample, NumPy {1e6 * theirs:.1f} µs, x {found['ratio']:.1f}; "
            f"{100 * found['of_real_time']:.2g} % of the time that the data last"
        )
    return 0


if __name__ == "__main__":
    sys.exit(main())
