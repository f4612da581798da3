"""ROS 2 packages: files, build without warnings, torques, allocations, and parameters that do not fit."""

from __future__ import annotations

import subprocess
import xml.etree.ElementTree as ElementTree
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from armid.codegen.generation import generate
from armid.codegen.language_input import identifier
from armid.export.code import export_code
from armid.model.base_parameters import find_base_parameters
from armid.model.dynamics_model import DynamicsModel
from armid.model.equations_of_motion import bias_torque
from armid.model.motion import Motion
from armid.model.terms import Coulomb, Hysteresis, LoadCoulomb, Offset, RigidBody, RotorInertia, Viscous
from armid.runs.run import Run
from armid.runs.validation_and_prediction import predict
from coded import CMAKE, write_files
from reports import make_run
from ros2_packages import EIGEN, MISSING, STAND_INS, Package
from trees import random_inertial, random_states, random_tree, robot_of

TOLERANCE = 1e-9
"""Relative to the largest torque: what the interface promises. Rounding is about 1e-15."""

COMPILED = pytest.mark.skipif(MISSING, reason="gcc, g++ or the headers of Eigen are missing")


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Run:
    return make_run(tmp_path_factory.mktemp("run"))


@pytest.fixture(scope="module")
def exported(run: Run, tmp_path_factory: pytest.TempPathFactory) -> Package:
    folder = tmp_path_factory.mktemp("package")
    export_code(run, "ros2", folder)
    return Package(folder, identifier(run.robot.name), run.robot.n)


@pytest.fixture(scope="module")
def built(exported: Package) -> Package:
    exported.build()
    return exported


@cache
def states_of(n: int, samples: int = 40) -> np.ndarray:
    return np.stack(random_states(np.random.default_rng(5), samples, n), axis=1)


def text_of(element: ElementTree.Element, path: str) -> str:
    found = element.findtext(path)
    assert found is not None and found.strip()
    return found.strip()


def test_the_manifest_and_the_plugin_name_what_there_is(exported: Package):
    manifest = ElementTree.parse(exported.folder / "package.xml").getroot()
    assert manifest.get("format") == "3" and text_of(manifest, "name") == exported.name
    assert text_of(manifest, "license") == "BSD-3-Clause"
    license_file = manifest.find("license")
    assert license_file is not None and (exported.folder / str(license_file.get("file"))).is_file()
    assert "not been run on a robot" in text_of(manifest, "description")
    found = {element.text for element in manifest.iter("depend")}
    assert found == {"eigen", "inverse_dynamics_solver", "pluginlib", "rclcpp"}
    library = ElementTree.parse(exported.folder / f"{exported.name}.xml").getroot()
    assert library.get("path") == exported.name
    (plugin,) = library.iter("class")
    source = (exported.folder / "src" / "solver.cpp").read_text()
    assert plugin.get("base_class_type") == "inverse_dynamics_solver::InverseDynamicsSolver"
    assert f"PLUGINLIB_EXPORT_CLASS({plugin.get('type')}, {plugin.get('base_class_type')})" in source
    assert "@" not in source.replace("@example", "")


def test_the_licence_is_that_of_the_repository(exported: Package):
    assert (exported.folder / "LICENSE").read_text() == (Path(__file__).parents[3] / "LICENSE").read_text()


def test_the_parameters_are_those_of_the_estimate(run: Run, exported: Package):
    given = exported.parameters()
    base, fit = run.estimate.base, run.estimate.fit
    values = dict(zip(fit.names, fit.values, strict=True))
    expected = [float(values[name]) for name in base.names]
    assert given["ids.base_parameters"] == expected and given["ids.friction_in_torques"] is True


@COMPILED
def test_the_torque_is_that_of_a_prediction(run: Run, built: Package):
    states = states_of(run.robot.n)
    found, calls = built.evaluate(states, built.parameters())
    expected = predict(run, Motion.of_states(*states.swapaxes(0, 1)))
    np.testing.assert_allclose(found["torque"], expected, atol=TOLERANCE * np.abs(expected).max(), rtol=0.0)
    whole = (
        np.einsum("nij,nj->ni", found["M"], states[:, 2]) + found["coriolis"] + found["gravity"] + found["friction"]
    )
    np.testing.assert_allclose(whole, expected, atol=TOLERANCE * np.abs(expected).max(), rtol=0.0)
    for name in ("M", "coriolis", "gravity"):
        assert (found[f"dynamic parameters {name}"] == found[name]).all()
    # The results of the interface are values on the heap; nothing else is, and the other functions need none.
    allocations = {name: count for name, count in calls.items() if not name.endswith("_ns")}
    assert allocations == {"compute": 0, "getTorques": 1, "getDynamicParameters": 3, "counter": 1}


@COMPILED
def test_another_estimate_needs_no_build(run: Run, built: Package, tmp_path: Path):
    fit = run.estimate.fit
    later = replace(run, estimate=replace(run.estimate, fit=replace(fit, values=1.25 * fit.values)))
    export_code(later, "ros2", tmp_path / "later")
    parameters = Package(tmp_path / "later", built.arm, built.joints).parameters()
    states = states_of(run.robot.n)
    before, _ = built.evaluate(states, None)
    after, _ = built.evaluate(states, parameters)
    np.testing.assert_allclose(after["torque"], 1.25 * before["torque"], rtol=1e-12)


@COMPILED
def test_torques_without_friction(built: Package):
    states = states_of(built.joints)
    found, _ = built.evaluate(states, {**built.parameters(), "ids.friction_in_torques": False})
    rigid = np.einsum("nij,nj->ni", found["M"], states[:, 2]) + found["coriolis"] + found["gravity"]
    np.testing.assert_allclose(found["torque"], rigid, atol=TOLERANCE * np.abs(rigid).max(), rtol=0.0)


@COMPILED
@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda given: {"ids.base_parameters": given["ids.base_parameters"][1:]}, "must have"),
        (lambda given: {"ids.base_parameters": [float("nan"), *given["ids.base_parameters"][1:]]}, "must be finite"),
        (lambda given: {"ids.model_digest": "0" * 64}, "belong to another model"),
    ],
)
def test_parameters_of_another_model_are_refused(built: Package, change: Callable[[dict], dict], message: str):
    given = built.parameters()
    done = built.run(states_of(built.joints), {**given, **change(given)})
    assert done.returncode == 5 and message in done.stderr


@COMPILED
def test_without_parameters_a_warning_is_logged(built: Package):
    done = built.run(states_of(built.joints), None)
    assert done.returncode == 0 and "no parameter 'ids.base_parameters'" in done.stderr
    done = built.run(states_of(built.joints), built.parameters())
    assert done.returncode == 0 and "WARN" not in done.stderr


def test_the_digest_is_that_of_the_model_and_not_of_the_estimate():
    robot = robot_of(random_tree(np.random.default_rng(1), 2, prismatic=0.0))

    def digest(width: float, scale: float) -> str:
        model = DynamicsModel(robot, (RigidBody(), Coulomb(width)))
        base = find_base_parameters(model)
        files = generate(model, base, np.full(base.count, scale), "ros2")
        (line,) = [x for x in files["config/parameters.yaml"].splitlines() if "model_digest:" in x]
        return line

    assert digest(0.1, 1.0) == digest(0.1, 2.0) != digest(0.2, 1.0)


@COMPILED
def test_friction_that_depends_on_earlier_motion_and_load(tmp_path: Path):
    """The state follows the positions; only friction of the velocity is told by the function of the velocity."""
    rng = np.random.default_rng(8)
    robot = robot_of(random_tree(np.random.default_rng(9), 3), "hysteretic")
    terms = (RigidBody(), Viscous(), Offset(), RotorInertia(), Hysteresis((0.1,)), LoadCoulomb(0.1))
    model = DynamicsModel(robot, terms, random_inertial(rng, 3))
    base, theta = find_base_parameters(model), rng.normal(size=len(model.parameters))
    theta[model.inertial_columns] = random_inertial(rng, 3).ravel()
    write_files(generate(model, base, base.values_of(theta), "ros2"), tmp_path)
    package = Package(tmp_path, "hysteretic", 3)
    package.build()
    states = states_of(3)
    found, _ = package.evaluate(states, package.parameters())
    motion, known = model.remembered(Motion.of_states(*states.swapaxes(0, 1)))
    since = int(known.max())
    assert since < len(states) // 2
    expected = model.torque(motion, theta)
    error = np.abs(found["torque"] - expected)[since:].max()
    assert error <= TOLERANCE * np.abs(expected).max()
    of_velocity = theta * [p.kind in ("viscous", "offset") for p in model.parameters]
    np.testing.assert_allclose(found["friction"], model.torque(motion, of_velocity), atol=1e-12)
    bias = bias_torque(model, motion.q, motion.dq, theta)
    np.testing.assert_allclose(found["coriolis"] + found["gravity"], bias, atol=1e-12 * np.abs(bias).max())
    header = (tmp_path / "include" / package.name / "solver.hpp").read_text()
    assert "all but: hysteresis, load-coulomb" in header and "from one thread" in header


@COMPILED
@pytest.mark.skipif(CMAKE is None, reason="there is no cmake")
@pytest.mark.parametrize("without_target", ["OFF", "ON"])
def test_cmake_builds_and_installs_the_package(exported: Package, tmp_path: Path, without_target: str):
    found = [f"-D{name}_DIR={STAND_INS / 'cmake'}" for name in
             ("ament_cmake", "Eigen3", "inverse_dynamics_solver", "pluginlib", "rclcpp")]  # fmt: skip
    options = [
        f"-DEIGEN_INCLUDE={EIGEN}",
        f"-DWITHOUT_TARGET={without_target}",
        f"-DCMAKE_INSTALL_PREFIX={tmp_path}/to",
    ]
    build = tmp_path / "build"
    command = [str(CMAKE), "-S", str(exported.folder), "-B", str(build), *found, *options]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert f"package {exported.name} is complete" in done.stdout and "Warning" not in done.stderr
    if without_target == "ON":
        return  # the rest is the same
    done = subprocess.run([str(CMAKE), "--build", str(build), "--target", "install"], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert "warning" not in done.stdout + done.stderr
    written = {str(path.relative_to(tmp_path / "to")) for path in (tmp_path / "to").rglob("*") if path.is_file()}
    share, include = f"share/{exported.name}", f"include/{exported.name}/{exported.name}"
    assert {f"{share}/{exported.name}.xml", f"{share}/config/parameters.yaml"} <= written
    assert {f"lib/lib{exported.name}.so", f"{include}/solver.hpp", f"{include}/{exported.arm}.h"} <= written
