"""`armid predict`: the torque that a run's model says for a motion."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer

from armid.cli.options import Json
from armid.cli.reading import Columns, TorqueSign, changed_reading
from armid.errors import ArmidError

__all__ = ["predict"]


def predict(
    run: Annotated[str, typer.Argument(help="Folder that armid identify made.")],
    motion: Annotated[
        str,
        typer.Argument(metavar="RECORDING | PLAN", help="A recording; a plan.json, its folder or files."),
    ],
    out: Annotated[Path, typer.Option("--out", metavar="FILE", help="Where to write, .csv or .npz.")] = Path(
        "torque.csv"
    ),
    band: Annotated[
        bool, typer.Option("--band", help="Write half of the 95 % band's width of each joint, too.")
    ] = False,
    plan_rate: Annotated[float, typer.Option(help="Samples a second of a plan, Hz.")] = 100.0,
    rate: Annotated[float | None, typer.Option(help="Samples a second of a recording without a clock, Hz.")] = None,
    torque_sign: TorqueSign = None,
    columns: Columns = None,
    json: Json = False,
) -> None:
    """Predict joint torques along a recording's motion or a plan and write them to a file.

    The band is that of the torque in the study's band of frequencies: a sensor's noise beyond it comes on top.

    Example:
        armid predict runs/today plan.json --band --out torque.csv
    """
    import numpy as np

    from armid.cli.console import print_findings
    from armid.notebook import plural
    from armid.runs import prediction
    from armid.runs.run import load_run
    from armid.study.extrapolation import speed_finding
    from armid.study.records import to_json

    if out.resolve() == Path(motion).resolve():
        raise ArmidError(f"{out} is the motion itself.", remedy="write the torque to another file with --out.")
    loaded = load_run(run)
    how = changed_reading(loaded.reading, rate, torque_sign, columns)
    along = prediction.motion_of(loaded, motion, rate=plan_rate, reading=how)
    torque = prediction.predict(loaded, along)
    width = prediction.band(loaded, along) if band else None
    path = prediction.write_torque(out, along, torque, loaded.robot.joint_names, band=width)
    if json:
        record = {"path": str(path), "samples": along.samples, "rms": np.sqrt(np.mean(torque**2, axis=0))}
        if width is not None:
            record["band95"] = np.median(width, axis=0)
        sys.stdout.write(to_json(record) + "\n")
    else:
        sys.stdout.write(
            f"{plural(along.samples, 'sample')} of {plural(loaded.robot.n, 'joint')} written to {path}\n"
        )
    asked = np.max(np.abs(along.dq), axis=0, initial=0.0)
    beyond = speed_finding(loaded.robot, loaded.estimate.speeds, asked, Path(motion).name)
    print_findings([] if beyond is None else [beyond])
