"""Identified payload in the axes of the flange, as controllers need it, with 95 % intervals."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from armid.checked_array import Array
from armid.errors import ArmidError, OutputError
from armid.estimation.update.payload import LOAD_NAMES, com_intervals, inertia_intervals
from armid.export.input_digest_check import find_source
from armid.export.load.principal_axes import PrincipalAxes, principal_axes, rotation_spread
from armid.input_boundary import boundary, read_json
from armid.maths.inertia import (
    about_com,
    about_com_slope,
    inertia_matrix,
    pseudo_inertia,
    transform,
    vector_to_com_inertia,
)
from armid.maths.rotations import homogeneous, rpy_rotation
from armid.robot import load_robot
from armid.robot.robot import CONSISTENCY_TOLERANCE
from armid.runs.payload import Payload, payload_record
from armid.runs.run import Run, load_run

MIXED = 1e-12
"""Absolute coefficient above which a parameter in the flange frame counts as dependent on one in another frame."""


WRONG = ("payload-misfit", "load-not-real", "load-missing", "description-does-not-match")
"""Codes of findings by which the parameters of a load are wrong, or are those of no load."""


@dataclass(frozen=True, eq=False, slots=True)
class FlangeLoad:
    """Payload in the axes of the flange.

    The ten parameters have the order of `armid.estimation.update.payload.LOAD_NAMES`.

    Attributes:
        robot: Name of the arm.
        run: Folder of the run of the arm without the payload.
        flange: Text that names the frame of the parameters.
        values: The ten parameters about the origin of the flange frame, shape (10,) [kg, kg·m, kg·m²].
        unconstrained: Estimate without the constraint of consistency, shape (10,).
        covariance: Covariance of `unconstrained`, shape (10, 10).
        quantile: Quantile of Student's t distribution for 95 % intervals.
        undetermined: Mask of the parameters that the recording does not determine, shape (10,).
        mass_interval: 95 % interval of the mass, shape (2,) [kg].
        unclear: Parameters that the recording determines badly, with their status, in the frame of the estimate.
    """

    robot: str
    run: str
    flange: str
    values: Array
    unconstrained: Array
    covariance: Array
    quantile: float
    undetermined: NDArray[np.bool_]
    mass_interval: Array
    unclear: tuple[str, ...]

    @property
    def mass(self) -> float:
        """Mass [kg]."""
        return float(self.values[0])

    @property
    def com(self) -> Array:
        """Centre of mass, shape (3,) [m]."""
        return vector_to_com_inertia(self.values)[1]

    @property
    def com_intervals(self) -> Array:
        """95 % intervals of the centre of mass, shape (3, 2) [m]; NaN where the recording does not determine it."""
        return com_intervals(self.values, self.covariance, self.quantile, self.undetermined)

    @property
    def inertia(self) -> Array:
        """Inertia about the centre of mass, in the axes of the flange, exactly symmetric, shape (3, 3) [kg·m²]."""
        return inertia_matrix(about_com(self.values)[4:])

    @property
    def inertia_intervals(self) -> Array:
        """95 % intervals of the elements of `inertia`, shape (3, 3, 2) [kg·m²]; NaN for undetermined elements."""
        six = inertia_intervals(self.values, self.unconstrained, self.covariance, self.quantile, self.undetermined)
        return np.stack([inertia_matrix(six[:, 0]), inertia_matrix(six[:, 1])], axis=2)

    def principal_axes(self) -> tuple[PrincipalAxes, Array, Array | None]:
        """Principal axes, 95 % intervals of the moments about them (3, 2) [kg·m²], and spread of the axes.

        The spread is that of `armid.export.load.principal_axes.rotation_spread`.
        """
        found = principal_axes(self.inertia)
        turned = [transform(each, found.axes.T, np.zeros(3)) for each in (self.values, self.unconstrained)]
        to_axes = transform(np.eye(10), found.axes.T, np.zeros(3)).T
        known = ~self.undetermined.any()
        covariance = to_axes @ self.covariance @ to_axes.T
        six = inertia_intervals(turned[0], turned[1], covariance, self.quantile, np.full(10, not known))
        slope = np.moveaxis(inertia_matrix(about_com_slope(self.values)[4:].T), 0, 2)
        spread = rotation_spread(found, slope, self.covariance, self.quantile) if known else None
        return found, six[[0, 2, 5]], spread


def load_at_flange(payload: Payload, flange: str | None = None) -> FlangeLoad:
    """Moves a payload to the flange.

    Args:
        payload: The payload.
        flange: Frame of the flange: the name of a frame of the description, or the pose of the flange in the tip
            frame, `"x,y,z,roll,pitch,yaw"` [m and rad]; by default the tip frame.

    Raises:
        OutputError: The payload is not on the link of the flange, is not a real body, a finding says that it is wrong
            or missing, or there is no such frame.
    """
    return _moved(payload_record(payload), payload.new_recordings.run, flange)


def read_load(path: Path | str, flange: str | None = None) -> FlangeLoad:
    """Reads the payload of a file `payload.json`, and moves it to the flange.

    Args:
        path: The file, or the folder that contains it.
        flange: Frame of the flange, as for `load_at_flange`.

    Raises:
        OutputError: The file cannot be read, or the payload cannot be moved, for the reasons of `load_at_flange`.
    """
    path = Path(path)
    path = path / "payload.json" if path.is_dir() else path
    what, remedy = "a payload of this version of armid", "run armid payload RUN RECORDING… --out FOLDER again."
    record = read_json(path, what, OutputError, remedy=remedy)
    with boundary(what, path, OutputError, remedy=remedy):
        return _moved(record, None, flange)


def _moved(record: Mapping[str, Any], run: Run | None, flange: str | None) -> FlangeLoad:
    """Payload in the axes of the flange, from the content of `payload.json`."""
    tip = record["tip"]
    if record["verdict"] == "fail":
        raise OutputError(
            "The recordings have errors, which make the load wrong, so it is not written for a controller.",
            remedy="correct the errors that armid payload reported, and estimate the load again.",
        )
    for finding in record["warnings"]:
        if finding["code"] in WRONG:
            raise OutputError(
                f"The load is not written for a controller because of the finding {finding['code']}: "
                f"{finding['evidence']}",
                remedy=finding["remedy"],
            )
    if tip["link"] != record["link"]:
        raise OutputError(
            f"The load is on the link {record['link']}, but load data of a controller are those of a load on the "
            f"flange, which is on the link {tip['link']}.",
            remedy="estimate a load on the link of the flange, or enter this load by hand where the controller has "
            "a place for loads on other links.",
        )
    ten = {each["name"]: each for each in record["parameters"]}
    values, unconstrained = (np.array([ten[name][key] for name in LOAD_NAMES], dtype=np.float64) for key in KEYS)
    _require_body(values)
    to_flange, words = _to_flange(record, run, flange)
    tip_pose = _numbers(tip["placement"], 4, 4) if record["frame"] != tip["name"] else np.eye(4)
    pose = _inverse(tip_pose @ to_flange)
    matrix = transform(np.eye(10), pose[:3, :3], pose[:3, 3]).T
    order = [list(ten).index(name) for name in LOAD_NAMES]
    covariance = _numbers(record["covariance"]["matrix"], len(ten), len(ten))[np.ix_(order, order)]
    undetermined = np.array([ten[name]["status"] == "not identifiable" for name in LOAD_NAMES])
    return FlangeLoad(
        record["robot"],
        record["run"],
        words,
        matrix @ values,
        matrix @ unconstrained,
        matrix @ covariance @ matrix.T,
        float(record["covariance"]["quantile"]),
        np.array([bool(undetermined[np.abs(row) > MIXED].any()) for row in matrix]),
        _numbers(record["mass"]["interval95"], 2),
        tuple(f"{name} {ten[name]['status']}" for name in ten if ten[name]["status"] != "identified"),
    )


KEYS = ("value", "unconstrained")


def _numbers(found: Any, *shape: int) -> Array:
    """Array of a record, in which null is NaN.

    Raises:
        ValueError: The array has another shape than it should have.
    """
    numbers = np.array(found, dtype=np.float64)
    if numbers.shape != shape:
        raise ValueError(f"an array of the shape {numbers.shape} stands in place of one of the shape {shape}")
    return numbers


def _inverse(pose: Array) -> Array:
    """Inverse of a homogeneous transform (4, 4)."""
    R = pose[:3, :3]
    return homogeneous(R.T, -R.T @ pose[:3, 3])


def _require_body(values: Array) -> None:
    """Raises an error if no real body has the inertial parameters (10,)."""
    eigenvalues = np.linalg.eigvalsh(pseudo_inertia(values))
    if not (values[0] > 0.0 and eigenvalues[0] >= -CONSISTENCY_TOLERANCE * abs(eigenvalues[-1])):
        raise OutputError(
            "No real body can have the inertial parameters of the load, so it is not written for a controller.",
            remedy="estimate the load again with armid payload, from a motion that turns and accelerates it.",
        )


def _to_flange(record: Mapping[str, Any], run: Run | None, flange: str | None) -> tuple[Array, str]:
    """Pose (4, 4) of the flange in the tip frame, and a text that names the flange frame."""
    tip = record["tip"]
    if flange is None or flange == tip["name"]:
        return np.eye(4), f"frame {tip['name']} of the description (the tip frame)"
    if "," in flange:
        pose = _pose(flange)
        return pose, f"x,y,z,roll,pitch,yaw = {flange} in the tip frame {tip['name']} (m, rad)"
    run = load_run(record["run"]) if run is None else run
    frame = _frame(run, flange)
    return _inverse(run.robot.tip.placement) @ frame, f"frame {flange} of the description"


def _pose(text: str) -> Array:
    """Pose (4, 4) that the text `x,y,z,roll,pitch,yaw` gives [m and rad]."""
    try:
        numbers = [float(word) for word in text.split(",")]
    except ValueError:
        numbers = []
    if len(numbers) != 6 or not np.isfinite(numbers).all():
        raise OutputError(
            f"The flange must be the name of a frame or six numbers; found {text!r}.",
            possible="x,y,z,roll,pitch,yaw of the flange in the tip frame, in m and rad, such as 0,0,0.05,0,0,0",
            remedy="correct --flange.",
        )
    return homogeneous(rpy_rotation(numbers[3:]), numbers[:3])


def _frame(run: Run, name: str) -> Array:
    """Pose (4, 4) of a frame of the description in the frame of the link that carries the tip."""
    source = find_source(run)
    joints: Sequence[str] = run.robot.joint_names
    try:
        robot = load_robot(source.path, tip=name, only=joints, lock=dict(source.locked))
    except ArmidError as error:
        raise OutputError(
            f"The description {source.path} has no frame {name!r} that could be the flange. {error.problem}",
            possible=error.possible,
            remedy="correct --flange, or give the pose of the flange: x,y,z,roll,pitch,yaw in the tip frame.",
        ) from error
    if robot.joint_names != run.robot.joint_names or robot.tip.parent != run.robot.tip.parent:
        raise OutputError(
            f"The frame {name!r} is not on the link that carries the load, so it cannot be the flange.",
            remedy="name a frame that is fixed to this link.",
        )
    return robot.tip.placement
