"""A whole plan from its `plan.json`: a series with its ways and repetitions, or poses; and what is around."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from armid.errors import ArmidError
from armid.excitation.experiments import Moves
from armid.excitation.fourier import PLAN_FILE, load_plan
from armid.excitation.plan import Plan
from armid.excitation.plans import PLANS, builtin_plan
from armid.robot.shapes import Shape

__all__ = ["PLAN_FILE", "is_plan", "read_whole_plan", "shape_records"]


def is_plan(name: str) -> bool:
    """Whether a name is that of a built-in plan, of a `plan.json` or of a folder with one."""
    return name in PLANS or name.endswith(".json") or (Path(name) / PLAN_FILE).is_file()


def read_whole_plan(name: str) -> tuple[Plan | Moves, tuple[Shape, ...]]:
    """The plan of a name, and what was around the arm when it was designed.

    Raises:
        ArmidError: There is none, or it lacks something.
    """
    if name in PLANS:
        return Plan(builtin_plan(name)), ()
    path = Path(name) / PLAN_FILE if Path(name).is_dir() else Path(name)
    try:
        record: Any = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise ArmidError(f"{path} is no plan: {error}.", remedy="give a plan.json.") from error
    if isinstance(record, dict) and "stretches" in record:
        return _moves(record, path), ()
    series = load_plan(path)
    try:
        plan = Plan(
            series,
            int(record.get("repetitions", 1)),
            _pose(record.get("begin")),
            _pose(record.get("end")),
            float(record.get("lead_in", 0.0)),
            float(record.get("lead_out", 0.0)),
        )
        return plan, tuple(_shape(each) for each in record.get("surroundings", ()))
    except (KeyError, TypeError, ValueError) as error:
        raise ArmidError(f"{path} is no plan: {error}.", remedy="design it again with armid excite.") from error


def shape_records(shapes: Sequence[Shape]) -> list[dict[str, Any]]:
    """Bodies that do not move, for a `plan.json`."""
    return [
        {"name": shape.name, "kind": shape.kind, "size": shape.size, "placement": shape.placement} for shape in shapes
    ]


def _shape(record: Mapping[str, Any]) -> Shape:
    return Shape(str(record["name"]), -1, record["kind"], np.array(record["size"]), np.array(record["placement"]))


def _pose(values: Sequence[float] | None) -> np.ndarray[Any, np.dtype[np.float64]] | None:
    return None if values is None else np.array(values, dtype=np.float64)


def _moves(record: Mapping[str, Any], path: Path) -> Moves:
    try:
        stretches = record["stretches"]
        return Moves(
            tuple(record["joints"]),
            np.array(record["poses"], dtype=np.float64),
            np.array([each["seconds"] for each in stretches], dtype=np.float64),
            np.array(record["speeds"], dtype=np.float64),
            tuple(str(each["kind"]) for each in stretches),
        )
    except (KeyError, TypeError, ValueError) as error:
        raise ArmidError(f"{path} is no plan: {error}.", remedy="design it again with armid excite.") from error
