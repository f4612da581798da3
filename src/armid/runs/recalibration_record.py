"""Writer and reader of `changes.json`, the file of a recalibrated run that lists the changes of parameters."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

from armid.estimation.estimate_record import EARLIER_RUN
from armid.estimation.update.parameter_change import ParameterChange
from armid.hashes import sha256_of_file
from armid.input_boundary import boundary, read_json
from armid.runs.run import Run

if TYPE_CHECKING:
    from armid.runs.recalibration import Recalibration

CHANGES = "changes.json"
"""Name of the file in the folder of a recalibrated run that contains the value of every base parameter before and
after the recalibration."""


def changes_record(recalibration: Recalibration) -> dict[str, Any]:
    """JSON object for `changes.json`: value of every base parameter before and after the recalibration."""
    base = recalibration.result.estimate.base
    units: dict[str, str] = dict(zip(base.names, base.units, strict=True))
    return {
        "earlier": recalibration.earlier,
        "let_change": recalibration.changed,
        "rms_before": [{"path": score.path, "rms": score.rms} for score in recalibration.before],
        "changes": [
            {
                "name": each.name,
                "unit": units[each.name],
                "before": each.before,
                "after": each.after,
                "change": each.change,
                "deviation": each.deviation,
                "half_interval": each.half,
                "ratio": each.ratio,
                "beyond": each.beyond,
            }
            for each in recalibration.changes
        ],
    }


def recorded_changes(before: Run, after: Run) -> tuple[ParameterChange, ...] | None:
    """Changes of the parameters that were recorded when one run was recalibrated from another.

    Args:
        before: The earlier run.
        after: The later run.

    Returns:
        Changes of every base parameter; `None` if the later run is not a recalibration of the earlier run.

    Raises:
        ArmidError: The record is damaged.
    """
    path, estimate = Path(after.folder) / CHANGES, Path(before.folder) / "estimate.npz"
    made_from = {each.sha256 for each in after.estimate.made_from if each.role == EARLIER_RUN}
    if not path.is_file() or not estimate.is_file() or sha256_of_file(estimate) not in made_from:
        return None
    remedy = "recalibrate again."
    record = read_json(path, "changes of parameters", remedy=remedy)
    with boundary("changes of parameters", path, remedy=remedy):
        return tuple(
            ParameterChange(
                str(each["name"]),
                *(
                    math.nan if each[key] is None else float(each[key])
                    for key in ("before", "after", "change", "deviation", "half_interval")
                ),
            )
            for each in record["changes"]
        )
