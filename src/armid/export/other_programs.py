"""Check of a written file with Pinocchio and MuJoCo: which parameters they read and which torque they compute."""

from __future__ import annotations

import importlib
import math
import os
import tempfile
from collections.abc import Callable, Generator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any

import numpy as np

from armid.checked_array import Array
from armid.export.types import Content, Witness
from armid.output.scratch import scratch_folder

SOURCE = "the written file"


def pinocchio_witness(
    make: Callable[[Any], Any], content: Content, q: Array, dq: Array, ddq: Array, *, reads: Sequence[str]
) -> Witness:
    """Rigid-body torque of the file, computed by Pinocchio with the locked joints at their locked positions.

    Args:
        make: Function that makes the model, given the module `pinocchio`.
        content: Content of the file.
        q: Positions, shape (N, n) [rad or m].
        dq: Velocities, shape (N, n).
        ddq: Accelerations, shape (N, n).
        reads: Names of the terms whose parameters Pinocchio reads from this format.
    """
    try:
        pin: Any = importlib.import_module("pinocchio")
    except ImportError:
        return Witness(
            "pinocchio", None, {}, "the package pin is not installed (pip install 'armid[witness]')", is_absent=True
        )
    model, complaint = _built(lambda: make(pin))
    if complaint:
        return Witness("pinocchio", None, {}, f"{SOURCE} cannot be read as a robot description: {complaint}")
    start = pin.neutral(model)
    for name, value in content.locked.items():
        if model.existJointName(name):
            _set(model, start, name, value)
    model.gravity = pin.Motion(np.array(content.robot.gravity), np.zeros(3))
    rotors = np.array(model.armature) + np.array(model.rotorInertia)
    model.armature = np.zeros(model.nv)
    names = content.robot.joint_names
    at = [model.joints[model.getJointId(name)].idx_v for name in names]
    data, torque = model.createData(), np.empty_like(q)
    for k in range(len(q)):
        position, velocity, acceleration = start.copy(), np.zeros(model.nv), np.zeros(model.nv)
        for name, value in zip(names, q[k], strict=True):
            _set(model, position, name, value)
        velocity[at], acceleration[at] = dq[k], ddq[k]
        torque[k] = pin.rnea(model, data, position, velocity, acceleration)[at]
    found = {"viscous": np.array(model.damping), "coulomb": np.array(model.friction), "rotor-inertia": rotors}
    return Witness("pinocchio", torque, _by_joint(names, at, found, reads))


def model_of_mjcf(pin: Any, text: str) -> Any:
    """Model that Pinocchio builds from the text of an MJCF in plain form.

    Args:
        pin: The module `pinocchio`.
        text: The text; Pinocchio reads files only.
    """
    with scratch_folder() as folder:
        path = folder / "plain.xml"
        path.write_text(text, encoding="utf-8")
        return pin.buildModelFromMJCF(str(path))


def _built(make: Callable[[], Any]) -> tuple[Any, str]:
    """Model that a function makes with Pinocchio, and the error messages of the parser; empty without errors."""
    result, reason = None, ""
    # urdfdom prints errors to the C++ standard error only, and continues without an inertia that it cannot read.
    with tempfile.TemporaryFile() as stderr:
        saved = os.dup(2)
        os.dup2(stderr.fileno(), 2)
        try:
            result = make()
        except (ValueError, RuntimeError) as error:
            reason = str(error).strip().splitlines()[-1].removeprefix("message:").strip()
        finally:
            os.dup2(saved, 2)
            os.close(saved)
        stderr.seek(0)
        lines = [line.strip() for line in stderr.read().decode(errors="replace").splitlines()]
    messages = [line.removeprefix("Error:").strip() for line in lines if line.startswith("Error:")]
    return result, "; ".join(messages) or reason


def mujoco_witness(text: str, content: Content, q: Array, dq: Array, ddq: Array, *, reads: Sequence[str]) -> Witness:
    """Rigid-body torque of the file, computed by MuJoCo without contacts, limits, springs and friction.

    Args:
        text: Text of the file, without elements that need meshes.
        content: Content of the file.
        q: Positions, shape (N, n) [rad or m].
        dq: Velocities, shape (N, n).
        ddq: Accelerations, shape (N, n).
        reads: Names of the terms whose parameters MuJoCo reads from this format.
    """
    try:
        mj: Any = importlib.import_module("mujoco")
    except ImportError:
        return Witness(
            "mujoco", None, {}, "the package mujoco is not installed (pip install 'armid[lab]')", is_absent=True
        )
    try:
        with without_log(mj):
            model = mj.MjModel.from_xml_string(text)
    except ValueError as error:
        return Witness("mujoco", None, {}, " ".join(str(error).split()))
    disable = mj.mjtDisableBit
    model.opt.disableflags |= disable.mjDSBL_CONSTRAINT | disable.mjDSBL_CONTACT
    model.opt.gravity[:] = content.robot.gravity
    model.opt.density, model.opt.viscosity, model.opt.wind[:] = 0.0, 0.0, 0.0
    names = content.robot.joint_names
    at = [int(model.joint(name).dofadr[0]) for name in names]
    positions = [int(model.joint(name).qposadr[0]) for name in names]
    found = {
        "viscous": np.array(model.dof_damping).reshape(model.nv, -1)[:, 0],
        "coulomb": np.array(model.dof_frictionloss).reshape(model.nv, -1)[:, 0],
        "rotor-inertia": np.array(model.dof_armature),
    }
    joints = _by_joint(names, at, found, reads)
    for other in ("dof_damping", "dof_frictionloss", "dof_armature", "jnt_stiffness", "body_gravcomp"):
        getattr(model, other)[:] = 0.0
    data, torque = mj.MjData(model), np.empty_like(q)
    for name, value in content.locked.items():
        joint = model.joint(name)
        if int(model.jnt_type[joint.id]) in (int(mj.mjtJoint.mjJNT_HINGE), int(mj.mjtJoint.mjJNT_SLIDE)):
            data.qpos[joint.qposadr[0]] = value
    for k in range(len(q)):
        data.qpos[positions], data.qvel[at], data.qacc[at] = q[k], dq[k], ddq[k]
        mj.mj_inverse(model, data)
        torque[k] = data.qfrc_inverse[at]
    return Witness("mujoco", torque, joints)


@contextmanager
def without_log(mj: Any) -> Generator[None]:
    """Prevents MuJoCo from writing its warnings into a file in the working folder."""
    before = mj.get_mju_user_warning()
    mj.set_mju_user_warning(_ignore_warning)
    try:
        yield
    finally:
        mj.set_mju_user_warning(before)


def _ignore_warning(_: str) -> None:
    """Does nothing; MuJoCo calls this function with each of its warnings."""


def _set(model: Any, position: Array, name: str, value: float) -> None:
    """Sets the position of a joint in a vector of positions of Pinocchio.

    Pinocchio stores the angle of a joint without limits as cosine and sine.
    """
    joint = model.joints[model.getJointId(name)]
    if joint.nv != 1:
        return
    if joint.nq == 2:
        position[joint.idx_q : joint.idx_q + 2] = math.cos(value), math.sin(value)
    else:
        position[joint.idx_q] = value


def _by_joint(
    names: Sequence[str], at: Sequence[int], found: Mapping[str, Array], reads: Sequence[str]
) -> dict[str, dict[str, float]]:
    return {name: {term: float(found[term][k]) for term in reads} for name, k in zip(names, at, strict=True)}
