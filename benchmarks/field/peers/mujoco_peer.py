"""Estimate of `mujoco.sysid` on exchanged rows; run by an interpreter that has it: `pip install "mujoco[sysid]"`.

    python mujoco_peer.py PROBLEM.npz RESULT.npz

The toolbox fits simulated motion. Here its parameters (pseudo-inertia of each body) and its optimiser fit the torque
of MuJoCo's inverse dynamics instead, so that it solves the problem of the other tools. Friction, rotor inertia and
offset of each joint are further parameters. The start is the description. Rows are thinned to about `ROWS`.
"""

from __future__ import annotations

import logging
import sys
import time
from functools import partial
from typing import Any

import numpy as np

ROWS = 400
"""Number of training rows: each Jacobian calls the inverse dynamics a hundred times on each of them."""

ITERATIONS = 15
"""Number of Gauss-Newton steps."""

WIDTH = 0.02
"""Velocity over which the sign of Coulomb friction changes, as in the other tools [rad/s]."""

LIMIT = 1e3
"""Limit of the parameters of a joint; large enough not to matter."""


def principal(name: str, change: Any, spec: Any, parameter: Any) -> None:
    """Set a body's inertia by its principal axes; MuJoCo 4.0.0 refuses the full inertia that the toolbox sets."""
    import mujoco

    change(spec, name, parameter)
    body = spec.body(name)
    xx, yy, zz, xy, xz, yz = np.ravel(body.fullinertia)
    moments, axes = np.linalg.eigh([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    quaternion = np.empty(4)
    mujoco.mju_mat2Quat(quaternion, (axes * np.sign(np.linalg.det(axes))).ravel())
    body.fullinertia = np.full(6, np.nan)
    body.inertia, body.iquat = moments, quaternion


def main() -> None:
    """Read the problem, solve it with MuJoCo's toolbox, and write the predicted torque."""
    import mujoco
    from mujoco import sysid

    logging.disable(logging.WARNING)
    given = np.load(sys.argv[1])
    described = mujoco.MjSpec.from_string(str(given["urdf"]))
    described.compile()
    spec = mujoco.MjSpec.from_string(described.to_xml())  # the toolbox cannot change what came from a URDF
    spec.option.gravity = given["gravity"]
    spec.option.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONTACT | mujoco.mjtDisableBit.mjDSBL_CONSTRAINT)
    nominal = spec.compile()
    joints = [str(name) for name in given["joints"]]
    n = len(joints)
    at = [nominal.jnt_dofadr[nominal.joint(name).id] for name in joints]
    params = sysid.ParameterDict()
    for k in range(1, nominal.nbody):
        if nominal.body_mass[k] > 0.0:
            name, kind = nominal.body(k).name, sysid.InertiaType.Pseudo
            changed = partial(principal, name, sysid.apply_body_inertia)
            params.add(sysid.body_inertia_param(spec, nominal, name, inertia_type=kind, modifier=changed))
    wide = np.full(n, LIMIT)
    for name in ("viscous", "coulomb", "rotor", "offset"):
        params.add(sysid.Parameter(name, np.zeros(n), -wide, wide, modifier=lambda spec, parameter: None))

    def torque(parameters: Any, which: str, rows: slice) -> Any:
        model = sysid.apply_param_modifiers(parameters, spec)
        data = mujoco.MjData(model)
        q, dq, ddq = (given[f"{which}_{name}"][rows] for name in ("q", "dq", "ddq"))
        result = np.empty_like(q)
        for k in range(len(q)):
            data.qpos[at], data.qvel[at], data.qacc[at] = q[k], dq[k], ddq[k]
            mujoco.mj_inverse(model, data)
            result[k] = data.qfrc_inverse[at]
        friction = parameters["viscous"].value * dq + parameters["coulomb"].value * np.tanh(dq / WIDTH)
        return result + friction + parameters["rotor"].value * ddq + parameters["offset"].value

    every = slice(None, None, max(1, len(given["train_q"]) // ROWS))
    measured, mask = given["train_torque"][every], given["train_mask"][every]
    weights = mask / given["noise"]

    def residual(x: Any, parameters: Any, **options: Any) -> Any:
        del options
        x = np.asarray(x)
        columns = []
        for column in x.reshape(len(x), -1).T:
            parameters.update_from_vector(column)
            columns.append(((torque(parameters, "train", every) - measured) * weights).ravel())
        return [columns[0]] if x.ndim == 1 else [np.column_stack(columns)], None, None

    began = time.process_time()
    found, _ = sysid.optimize(params, residual, verbose=False, max_iters=ITERATIONS)
    seconds = time.process_time() - began
    np.savez(sys.argv[2], torque=torque(found, "unseen", slice(None)), seconds=seconds)


if __name__ == "__main__":
    main()
