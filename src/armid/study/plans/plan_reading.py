"""Reading of the files of a plan: `plan.json` with motion and surroundings, and motion files for controllers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from armid.errors import ArmidError, Finding
from armid.excitation.formats import FORMATS
from armid.excitation.fourier import PLAN_FILE, Excitation, load_plan
from armid.excitation.limits.joint_limits import Limits
from armid.excitation.plan import Plan
from armid.excitation.poses_and_sweeps import Moves
from armid.excitation.thesis_plans import PLANS, builtin_plan
from armid.input_boundary import boundary, naming, read_json
from armid.model.motion import Motion
from armid.robot.robot import Robot
from armid.robot.shapes import Shape

PLAN, REMEDY = "a plan", "give a plan.json that armid excite has written, or design the plan again."
"""Name of a file of a plan, and remedy if it is damaged, for messages."""


def is_plan(name: str) -> bool:
    """True if a name is that of a built-in plan, of a `plan.json`, or of a folder that contains a `plan.json`."""
    return name in PLANS or name.endswith(".json") or (Path(name) / PLAN_FILE).is_file()


def series_of(name: str) -> Excitation:
    """Excitation of a built-in plan, of a `plan.json`, of the folder of a plan, or of a motion file in this folder.

    Raises:
        ArmidError: There is no such plan.
    """
    if name in PLANS:
        return builtin_plan(name)
    path = Path(name)
    written = any(path.name == f"{Path(PLAN_FILE).stem}{form.SUFFIX}" for form in FORMATS.values())
    neighbour = path.with_name(PLAN_FILE)
    return load_plan(neighbour if written and neighbour.is_file() else path)


def motion_of_plan(name: str, robot: Robot, rate: float) -> Motion | None:
    """Motion of a plan or of a motion file for a controller; `None` if the name is that of neither of them.

    Args:
        name: Name of a built-in plan, or path of a `plan.json`, of the folder of a plan, or of a motion file in one
            of the formats of `armid excite`.
        robot: The arm.
        rate: Sample rate of a plan [Hz]; a motion in a file has its own rate.

    Raises:
        ArmidError: The plan cannot be read, or it is for another arm.
    """
    if not is_plan(name):
        return _motion_of_format(Path(name), robot)
    if not 0.0 < rate < np.inf:
        raise ArmidError(
            f"The sample rate of a plan must be above 0; found {rate:g} Hz.", remedy="give a positive --plan-rate."
        )
    plan, _ = read_whole_plan(name)
    motion = plan.sample(rate) if isinstance(plan, Moves) else plan.excitation.sample(rate)
    if motion.n != robot.n:
        raise ArmidError(
            f"{name} moves {motion.n} joints, but {robot.name} has {robot.n}.", remedy="give a plan for this arm."
        )
    return motion


def other_joints_of_plan(name: str, robot: Robot) -> tuple[Finding, ...]:
    """Finding that a plan was designed for joints with other names than those of the arm; empty if the names agree.

    Args:
        name: Name of a built-in plan, or path of a `plan.json`, of the folder of a plan, or of a motion file.
        robot: The arm.
    """
    if name in PLANS:
        return ()
    path = Path(name) / PLAN_FILE if Path(name).is_dir() else Path(name)
    if path.suffix != Path(PLAN_FILE).suffix and path.name.startswith(f"{Path(PLAN_FILE).stem}."):
        path = path.with_name(PLAN_FILE)  # a motion file of the plan beside it
    if path.suffix != Path(PLAN_FILE).suffix:
        return ()
    found: Any = read_json(path, PLAN, remedy=REMEDY).get("joints") if path.is_file() else None
    joints = tuple(str(each) for each in found) if isinstance(found, list) else ()
    if not joints or joints == robot.joint_names:
        return ()
    return (
        Finding(
            "plan-of-other-joints",
            "warning",
            "",
            f"{name} was designed for the joints {', '.join(joints)}, but those of {robot.name} are "
            f"{', '.join(robot.joint_names)}. The joints are matched by their order, not by their names.",
            "if the plan is for another arm, give a plan for this arm; if only the names of the joints differ, no "
            "action is needed.",
        ),
    )


def _motion_of_format(path: Path, robot: Robot) -> Motion | None:
    """Motion in a file for a controller, with the joints of the robot; `None` if the file has another format."""
    for form in FORMATS.values():
        if path.name.endswith(form.SUFFIX) and path.is_file():
            try:
                track = form.read(path.read_bytes())
            except ArmidError:
                continue
            if set(track.joints) == set(robot.joint_names):
                motion, order = track.motion, [track.joints.index(name) for name in robot.joint_names]
                return Motion(motion.time, motion.q[:, order], motion.dq[:, order], motion.ddq[:, order])
    return None


def read_whole_plan(name: str) -> tuple[Plan | Moves, tuple[Shape, ...]]:
    """Reads a plan and the surroundings for which it was designed.

    Raises:
        ArmidError: There is no such plan, or it is incomplete.
    """
    if name in PLANS:
        return Plan(builtin_plan(name)), ()
    path = Path(name) / PLAN_FILE if Path(name).is_dir() else Path(name)
    record = read_json(path, PLAN, remedy=REMEDY)
    if "stretches" in record:
        return _moves(record, path), ()
    series = load_plan(path)
    with boundary(PLAN, path, remedy=REMEDY), naming(path):
        plan = Plan(
            series,
            int(record.get("repetitions", 1)),
            _pose(record.get("begin")),
            _pose(record.get("end")),
            float(record.get("lead_in", 0.0)),
            float(record.get("lead_out", 0.0)),
        )
        return plan, tuple(_shape(each) for each in record.get("surroundings", ()))


def limits_of_plan(name: str, robot: Robot) -> Limits | None:
    """Limits of the joints with which a plan was designed; `None` if the file has no limits for these joints.

    Args:
        name: Name of a built-in plan, or path of a `plan.json` or of the folder of a plan.
        robot: The arm.

    Raises:
        ArmidError: The limits cannot be read.
    """
    path = Path(name) / PLAN_FILE if Path(name).is_dir() else Path(name)
    if name in PLANS or not path.is_file():
        return None
    record = read_json(path, PLAN, remedy=REMEDY)
    with boundary("a plan with `joint_limits`", path, remedy=REMEDY), naming(path):
        limits: Any = record.get("joint_limits")
        if limits is None or tuple(record.get("joints", ())) != robot.joint_names:
            return None
        values = {
            key: np.array([unknown if x is None else x for x in limits[key]], dtype=np.float64)
            for key, unknown in LIMITS_LEFT_OUT.items()
        }
        return Limits(robot.joint_names, **values)


LIMITS_LEFT_OUT = {"lower": -np.inf, "upper": np.inf} | dict.fromkeys(
    ("velocity", "acceleration", "jerk", "effort"), np.inf
)
"""Values that stand for null (no limit) in the joint limits of a `plan.json`, by kind of limit."""


def limits_record(limits: Limits) -> dict[str, Any]:
    """Converts limits of the joints to the record, by kind, under the key `joint_limits` of a `plan.json`."""
    return {key: getattr(limits, key) for key in LIMITS_LEFT_OUT}


def shape_records(shapes: Sequence[Shape]) -> list[dict[str, Any]]:
    """Converts bodies of the surroundings to the records under the key `surroundings` of a `plan.json`."""
    return [
        {"name": shape.name, "kind": shape.kind, "size": shape.size, "placement": shape.placement} for shape in shapes
    ]


def _shape(record: Mapping[str, Any]) -> Shape:
    return Shape(str(record["name"]), -1, record["kind"], np.array(record["size"]), np.array(record["placement"]))


def _pose(values: Sequence[float] | None) -> np.ndarray[Any, np.dtype[np.float64]] | None:
    return None if values is None else np.array(values, dtype=np.float64)


def _moves(record: Mapping[str, Any], path: Path) -> Moves:
    with boundary(PLAN, path, remedy=REMEDY):
        segments = record["stretches"]
        return Moves(
            tuple(record["joints"]),
            np.array(record["poses"], dtype=np.float64),
            np.array([each["seconds"] for each in segments], dtype=np.float64),
            np.array(record["speeds"], dtype=np.float64),
            tuple(str(each["kind"]) for each in segments),
        )
