"""`armid predict`: torque that the model of a run predicts for a motion."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from armid.cli.log_format_options import Columns, Edges, Period, Preset, TorqueSign, changed_reading
from armid.cli.options import Json
from armid.errors import ArmidError

if TYPE_CHECKING:
    from armid.checked_array import Array
    from armid.runs.run import Run


def predict(
    run: Annotated[str, typer.Argument(help="Folder that armid identify made.")],
    motion: Annotated[
        str,
        typer.Argument(
            metavar="RECORDING | PLAN",
            help="A recording, a plan.json, the folder of a plan, or a motion file in this folder.",
        ),
    ],
    out: Annotated[Path, typer.Option("--out", metavar="FILE", help="File to write, .csv or .npz.")] = Path(
        "torque.csv"
    ),
    band: Annotated[
        bool, typer.Option("--band", help="Also write half the width of the 95 % prediction interval of each joint.")
    ] = False,
    plan_rate: Annotated[float, typer.Option(help="Sampling rate of a plan, Hz.")] = 100.0,
    rate: Annotated[float | None, typer.Option(help="Sampling rate of a recording without a clock, Hz.")] = None,
    torque_sign: TorqueSign = None,
    columns: Columns = None,
    period: Period = None,
    preset: Preset = None,
    edges: Edges = None,
    json: Json = False,
) -> None:
    """Predict joint torques along the motion of a recording or a plan, and write them to a file.

    The interval holds for the torque in the pass-band of the study; sensor noise above the cut-off is not included.

    Example:
        armid predict runs/today plan.json --band --out torque.csv
    """
    import numpy as np

    from armid.cli.console import print_findings
    from armid.runs import validation_and_prediction
    from armid.runs.run import load_run, with_edges
    from armid.study.extrapolation import speed_finding

    if out.resolve() == Path(motion).resolve():
        raise ArmidError(
            f"The torque cannot be written to {out}, because this file is the motion.",
            remedy="write the torque to another file with --out.",
        )
    loaded = with_edges(load_run(run), edges)
    reading = changed_reading(loaded.log_format, rate, torque_sign, columns, None, period, preset)
    along, findings = validation_and_prediction.motion_of(loaded, motion, rate=plan_rate, reading=reading)
    torque = validation_and_prediction.predict(loaded, along)
    width = validation_and_prediction.band(loaded, along) if band else None
    path = validation_and_prediction.write_torque(out, along, torque, loaded.robot.joint_names, band=width)
    sys.stdout.write(_summary(loaded, path, torque, width, json=json) + "\n")
    top_speed = np.max(np.abs(along.dq), axis=0, initial=0.0)
    beyond = speed_finding(loaded.robot, loaded.estimate.speeds, top_speed, Path(motion).name)
    print_findings([*findings, *([] if beyond is None else [beyond])])


def _summary(run: Run, path: Path, torque: Array, width: Array | None, *, json: bool) -> str:
    """Text, or JSON object if `json`, about a written torque (N, n) and the half widths (N, n) of its intervals."""
    import numpy as np

    from armid.notebook_display import plural
    from armid.study.storage.records import to_json

    if not json:
        return f"{plural(len(torque), 'sample')} of {plural(run.robot.n, 'joint')} written to {path}"
    record = {"path": str(path), "samples": len(torque), "rms": np.sqrt(np.mean(torque**2, axis=0))}
    if width is not None:
        record["band95"] = np.median(width, axis=0)
    return to_json(record)
