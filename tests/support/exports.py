"""Runs that need no data: an arm's description with parameters put in, for the tests of exports."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from importlib.util import find_spec
from pathlib import Path

import numpy as np

from armid.checked_array import Array
from armid.estimation.estimate_record import Estimate, InputDigest
from armid.estimation.fit_result import Fit
from armid.estimation.problem import bare_standard
from armid.estimation.standard_parameter_resolution import PriorUse, Proof, StandardFit
from armid.maths.inertia import pseudo_inertia, vector_from_pseudo_inertia
from armid.measurement.log_format import LogFormat
from armid.measurement.processing.options import ProcessingOptions
from armid.model.base_parameters import find_base_parameters
from armid.model.dynamics_model import DynamicsModel
from armid.model.terms import Coulomb, Offset, RigidBody, RotorInertia, Term, Viscous
from armid.robot import load_robot
from armid.runs.run import Run
from trees import random_inertial

URDF = """<?xml version="1.0"?>
<!-- An arm as they come: <inertial> in a comment, tabs, one line where others have ten. -->
<robot name="odd" xmlns:sim="urn:simulator">
  <material name="grey"><color rgba="0.5 0.5 0.5 1"/></material>
  <link name="base"><inertial><mass value="9"/>
      <inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial></link>
  <joint name="a" type="revolute">
    <axis xyz="0 0 1"/> <parent link="base"/><child link="one"/>
    <dynamics friction='0.1'   damping = "0.7"/> <!-- measured in 2009 -->
    <limit lower="-2" upper="2" effort="50" velocity="3"/>
  </joint>
\t<link name="one">
\t\t<inertial> <!-- from the CAD -->
\t\t\t<inertia ixx="0.05" ixy="0.001" ixz="0" iyy="0.06" iyz="0" izz="0.04"/>
\t\t\t<mass value="3.0"></mass>
\t\t\t<origin rpy="0.1 0.2 0.3" xyz="0.01 0.02 0.1"/>
\t\t</inertial>
\t</link>
  <link name="plate"><inertial><origin xyz="0 0 0.01"/><mass value="0.2"/>
      <inertia ixx="1e-3" ixy="0" ixz="0" iyy="1e-3" iyz="0" izz="1e-3"/></inertial></link>
  <joint name="plate_joint" type="fixed"><parent link="one"/><child link="plate"/>
    <origin xyz="0 0.1 0.1" rpy="0 0.3 0"/></joint>
  <joint name="b" type="prismatic"><parent link="plate"/><child link="two"/>
    <origin xyz="0 0 0.3" rpy="1.5707963267948966 0 0"/>
    <axis xyz="0 1 0"/><limit lower="-0.4" upper="0.4" effort="9" velocity="1"/></joint>
  <link name="two"/>
  <joint name="weld" type="fixed"><parent link="two"/><child link="heavy"/>
    <origin xyz="0.1 0 0" rpy="0 0 0.4"/></joint>
  <link name="heavy"><inertial><mass value="2"/><origin xyz="0 0.1 0"/>
      <inertia ixx="0.02" ixy="0" ixz="0" iyy="0.02" iyz="0" izz="0.02"/></inertial></link>
  <joint name="c" type="continuous"><parent link="heavy"/><child link="three"/>
    <origin xyz="0 0.2 0"/><axis xyz="1 0 0"/></joint>
  <link name="three"><inertial><mass value="1"/><origin xyz="0 0 0.2"/>
      <inertia ixx="0.02" ixy="0" ixz="0" iyy="0.02" iyz="0" izz="0.01"/></inertial>
    <visual><geometry><mesh filename="meshes/three.stl"/></geometry></visual></link>
  <joint name="finger" type="prismatic"><parent link="three"/><child link="tip"/>
    <origin xyz="0 0 0.3"/><axis xyz="0 1 0"/>
    <limit lower="0" upper="0.1" effort="9" velocity="1"/><mimic joint="c"/></joint>
  <link name="tip"><inertial><mass value="0.1"/>
      <inertia ixx="1e-4" ixy="0" ixz="0" iyy="1e-4" iyz="0" izz="1e-4"/></inertial></link>
  <gazebo reference="three"><sim:nothing/></gazebo>
</robot>
"""
"""Comments, tabs, elements in any order, a fixed body, a mere frame with a heavy body on it, a finger to lock."""

LOCKED = {"finger": 0.03}

WITNESSES = ("mujoco", *(["pinocchio"] if find_spec("pinocchio") else []))
"""Other programs that are installed here and check a written file; Pinocchio is an extra."""

MJCF = """<!-- a comment first -->
<mujoco model="odd">
  <compiler angle="degree" eulerseq="zyx" meshdir="meshes"/>
  <default><joint damping="5" armature="0.3"/><geom type="mesh"/></default>
  <asset><mesh name="shell" file="shell.stl"/></asset>
  <worldbody>
    <geom type="plane" size="1 1 1"/>
    <body name="one" pos="0 0 0.2">
      <inertial pos="0 0.01 0.1" mass="2" diaginertia="0.02 0.03 0.04" quat="1 0.1 0 0"/>
      <joint name="a" axis="0 0 1" damping='3' range="-90 90"/> <geom mesh="shell"/>
      <body pos="0 0 0.3" euler="10 20 30">
        <joint pos="0 0.05 0" axis="0 1 0"/>
        <geom type="box" size="0.05 0.05 0.1" mass="1.5"/>
        <body name="cover" pos="0 0 0.1"><geom mesh="shell"/></body>
        <body name="ball" pos="0.1 0 0"><geom type="sphere" size="0.03" mass="0.2"/></body>
      </body>
    </body>
  </worldbody>
  <actuator><motor joint="a" gear="2"/></actuator>
</mujoco>
"""
"""Defaults, meshes, a body without a name, inertia from shapes, a cover whose mass only a mesh could tell."""

TERMS: tuple[Term, ...] = (RigidBody(), Viscous(), Coulomb(width=0.02), Offset(), RotorInertia())


def changed(inertial: Array, rng: np.random.Generator, size: float = 0.2) -> Array:
    """Bodies (n, 10) of other mass and shape: each pseudo-inertia deformed a little, so that it stays one."""
    deform = np.eye(4) + size * rng.normal(size=(len(inertial), 4, 4)) * np.array([0.3, 0.3, 0.3, 1.0])[:, None]
    return vector_from_pseudo_inertia(deform @ pseudo_inertia(inertial) @ np.swapaxes(deform, 1, 2))


def run_of(
    folder: Path,
    description: Path | str,
    *,
    seed: int = 0,
    inertial: Array | None = None,
    locked: Mapping[str, float] | Sequence[str] = (),
    terms: tuple[Term, ...] = TERMS,
    standard: bool = True,
    gravity: tuple[float, float, float] | None = None,
) -> Run:
    """A run of an arm whose parameters are those of its description, deformed, with friction.

    With `standard` the method is one that estimates standard parameters; otherwise only base values are known.
    """
    robot = load_robot(description, locked=locked, gravity=gravity)
    model = DynamicsModel(robot, terms)
    rng = np.random.default_rng(seed)
    if inertial is None:
        nominal = robot.inertial_vector
        inertial = changed(random_inertial(rng, robot.n) if nominal is None else nominal, rng)
    theta = rng.uniform(0.1, 2.0, len(model.parameters))
    theta[model.inertial_columns] = inertial.ravel()
    return run_with(folder, description, model, theta, locked=locked, standard=standard, gravity=gravity)


def run_with(
    folder: Path,
    description: Path | str,
    model: DynamicsModel,
    theta: Array,
    *,
    locked: Mapping[str, float] | Sequence[str] = (),
    standard: bool = True,
    gravity: tuple[float, float, float] | None = None,
) -> Run:
    """A run with given standard parameters, its record of the study in `folder`."""
    base = find_base_parameters(model)
    b, n = base.count, model.n
    bodies = None
    if standard:
        p = len(theta)
        bare = bare_standard(model)
        ends, prior, proof = np.stack([theta, theta], 1), PriorUse("none", 0.0, "", 1.0), Proof(0.0, 0.0, 0.0, 0.0)
        status = ("identified",) * p
        bodies = StandardFit(bare.names, bare.units, theta, np.zeros((p, p)), ends, np.ones(p), status, prior, proof)
    fit = Fit(
        base.names,
        base.values_of(theta),
        np.full(b, 0.1),
        0.01 * np.eye(b),
        "white",
        100.0,
        np.full(n, 0.1),
        np.full(n, 1000),
        10.0,
        10.0,
        standard=bodies,
    )
    method = "physical" if standard else "wls"
    estimate = Estimate(
        model.robot.name, method, (), base, fit, made_from=(InputDigest("robot", model.robot.sha256),)
    )
    choice = {"description": str(description), "gravity": gravity, "locked": locked, "tip": None}
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "study.json").write_text(json.dumps({"robot": choice, "folder": ".", "recordings": []}))
    return Run(str(folder), model.robot, model, estimate, ProcessingOptions(), LogFormat(), ())
