"""Least squares of FIGAROH on exchanged rows; run by an interpreter that has the package: `pip install figaroh`.

    python figaroh_peer.py PROBLEM.npz RESULT.npz

FIGAROH's regressor with viscous friction, sign friction, actuator inertia and offset is reduced to its base
parameters by its QR decomposition. Rows are weighted by the noise of a first unweighted fit, similar to `wls`.
"""

from __future__ import annotations

import sys
import time
from types import SimpleNamespace
from typing import Any

import numpy as np

TINY = 1e-6
"""Squared length below which a column counts as zero, the default of FIGAROH."""


def main() -> None:
    """Read the problem, solve it with FIGAROH, and write the predicted torque."""
    import pinocchio as pin
    from figaroh.tools.qrdecomposition import get_baseParams
    from figaroh.tools.regressor import build_regressor_basic

    given = np.load(sys.argv[1])
    model = pin.buildModelFromXML(str(given["urdf"]))
    model.gravity.linear = given["gravity"]
    order = [model.joints[model.getJointId(str(name))].idx_v for name in given["joints"]]
    robot = SimpleNamespace(model=model, data=model.createData())
    options = {
        "is_joint_torques": True,
        "is_external_wrench": False,
        "has_friction": True,
        "has_actuator_inertia": True,
        "has_joint_offset": True,
        "act_idxv": list(range(model.nv)),
    }

    def regressor(which: str) -> Any:
        states = [np.empty_like(given[f"{which}_{name}"]) for name in ("q", "dq", "ddq")]
        for state, name in zip(states, ("q", "dq", "ddq"), strict=True):
            state[:, order] = given[f"{which}_{name}"]
        return build_regressor_basic(robot, *states, options)

    began = time.process_time()
    W = regressor("train")
    n, rows = len(order), len(given["train_q"])
    lengths = np.sum(W**2, axis=0)
    kept = np.flatnonzero(lengths > TINY)
    names = [f"c{k}" for k in kept]
    base = np.asarray(get_baseParams(W[:, kept], names)[2], dtype=int)
    columns = kept[base]
    torque, used = np.empty((n, rows)), np.empty((n, rows), dtype=bool)
    torque[order], used[order] = given["train_torque"].T, given["train_mask"].T
    y, mask = torque.ravel(), used.ravel()
    weights = np.ones(len(y))
    for _ in range(2):
        scaled = W[:, columns] * weights[:, None]
        values = np.linalg.lstsq(scaled[mask], (y * weights)[mask], rcond=None)[0]
        residual = (y - W[:, columns] @ values).reshape(n, rows)
        deviation = np.sqrt(np.sum(residual**2 * used, axis=1) / np.maximum(used.sum(axis=1), 1))
        weights = np.repeat(1.0 / deviation, rows)
    seconds = time.process_time() - began
    predicted = (regressor("unseen")[:, columns] @ values).reshape(n, -1)
    np.savez(sys.argv[2], torque=predicted[order].T, seconds=seconds)


if __name__ == "__main__":
    main()
