"""Written descriptions against Pinocchio and MuJoCo, each loading the file by itself."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest

from armid import kernel
from armid.export.write import export_run
from armid.robot import load_robot
from exports import LOCKED, MJCF, URDF, run_of

pin = pytest.importorskip("pinocchio", reason="the package pin is not installed")
pytestmark = pytest.mark.witness

TOLERANCE = 1e-12
"""On torque of a hundred newton metres at most: the rounding of three independent recursions."""


def states(n: int) -> np.ndarray:
    return np.random.default_rng(n).uniform(-0.3, 0.3, (3, 5, n))


def expected(run, theta) -> np.ndarray:
    inertial = theta[run.model.inertial_columns].reshape(-1, 10)
    return kernel.inverse_dynamics(run.robot.tree, inertial, *states(run.robot.n))


@pytest.mark.parametrize("arm", ["odd.urdf", "iiwa14-r820"])
def test_a_urdf_in_pinocchio(tmp_path: Path, arm: str):
    if arm == "odd.urdf":
        (tmp_path / arm).write_text(URDF)
        run = run_of(tmp_path / "run", tmp_path / arm, locked=LOCKED)
    else:
        run = run_of(tmp_path / "run", arm)
    path = export_run(run, "urdf").path
    model = pin.buildModelFromUrdf(str(path))
    model.gravity.linear = np.array(run.robot.gravity)
    data = model.createData()
    fit = run.estimate.fit.standard
    assert fit is not None
    value = dict(zip(fit.names, fit.values, strict=True))
    for k, name in enumerate(run.robot.joint_names):
        v = model.joints[model.getJointId(name)].idx_v
        assert (model.damping[v], model.friction[v]) == (value[f"FV_{k + 1}"], value[f"FS_{k + 1}"])
    tau = expected(run, fit.values)
    for q, dq, ddq, wanted in zip(*states(run.robot.n), tau, strict=True):
        position, rates = pin.neutral(model), np.zeros((2, model.nv))
        for name, held in (LOCKED if arm == "odd.urdf" else {}).items():
            position[model.joints[model.getJointId(name)].idx_q] = held
        at = []
        for name, angle in zip(run.robot.joint_names, q, strict=True):
            joint = model.joints[model.getJointId(name)]
            where = slice(joint.idx_q, joint.idx_q + joint.nq)
            position[where] = [np.cos(angle), np.sin(angle)] if joint.nq == 2 else angle
            at.append(joint.idx_v)
        rates[:, at] = dq, ddq
        found = pin.rnea(model, data, position, *rates)[at]
        np.testing.assert_allclose(found, wanted, rtol=0, atol=TOLERANCE * max(1.0, np.abs(tau).max()))


@pytest.mark.parametrize("arm", ["odd.xml", "ur5e", "panda"])
def test_an_mjcf_in_mujoco(tmp_path: Path, arm: str):
    """With friction and rotors: MuJoCo's passive forces and armature are what the run found."""
    if arm == "odd.xml":
        text = MJCF.replace(
            '<mesh name="shell" file="shell.stl"/>', '<mesh name="shell" vertex="0 0 0 1 0 0 0 1 0 0 0 1"/>'
        )
        (tmp_path / arm).write_text(text)
        run = run_of(tmp_path / "run", tmp_path / arm)
    else:
        run = run_of(tmp_path / "run", arm)
    model = mujoco.MjModel.from_xml_path(str(export_run(run, "mjcf").path))
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
    data = mujoco.MjData(model)
    fit = run.estimate.fit.standard
    assert fit is not None
    value = dict(zip(fit.names, fit.values, strict=True))
    n = run.robot.n
    viscous, coulomb, rotor = (np.array([value[f"{s}_{j + 1}"] for j in range(n)]) for s in ("FV", "FS", "IA"))
    assert model.dof_frictionloss.ravel().tolist() == coulomb.tolist()
    tau = expected(run, fit.values)
    for q, dq, ddq, wanted in zip(*states(n), tau, strict=True):
        data.qpos[:], data.qvel[:], data.qacc[:] = q, dq, ddq
        mujoco.mj_inverse(model, data)
        whole = wanted + viscous * dq + rotor * ddq
        np.testing.assert_allclose(data.qfrc_inverse, whole, rtol=0, atol=TOLERANCE * max(1.0, np.abs(tau).max()))


def test_an_mjcf_of_a_urdf_and_a_urdf_of_an_mjcf_are_one_arm(tmp_path: Path):
    (tmp_path / "odd.urdf").write_text(URDF)
    run = run_of(tmp_path / "run", tmp_path / "odd.urdf", locked=LOCKED)
    edited = load_robot(export_run(run, "urdf").path, locked=LOCKED)
    for robot in (edited, load_robot(export_run(run, "mjcf").path)):
        tau = kernel.inverse_dynamics(robot.tree, np.array(robot.inertial_vector), *states(3))
        fit = run.estimate.fit.standard
        assert fit is not None
        np.testing.assert_allclose(tau, expected(run, fit.values), rtol=0, atol=TOLERANCE * 100)
