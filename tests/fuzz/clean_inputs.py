"""One folder with a clean input of every kind."""

from __future__ import annotations

import contextlib
import gzip
import io
import json
import shutil
from pathlib import Path

import numpy as np
from fleet_inputs import write_fleet_inputs
from servo_inputs import write_servo_inputs

ROOT = Path(__file__).parents[1]

STUDY = """
[robot]
description = "small.urdf"
gravity = [0.0, 0.0, -9.81]
lock = {}

[model]
terms = ["rigid-body", "viscous", "coulomb"]
coulomb = { width = 0.02 }

[processing]
cutoff = 5.0
edges = "drop"

[estimation]
method = "ols"

[[recording]]
path = "log.csv"
torque_sign = [1, 1, 1]
drive_gain = [1.0, 1.0, 1.0]
transmission = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]
joint_offset = [0.0, 0.0, 0.0]
columns = { time = "t", q = "q{}", effort = ["tau1", "tau2", "tau3"] }
joints = ["joint_1", "joint_2", "joint_3"]
exclude = [[0.1, 0.2]]
period = "none"
units = "rad"
delay = 0.0

[[recording]]
path = "other.csv"
role = "validate"
part = [0.0, 0.9]
"""

LAB = """
mode = "inverse-dynamics"
repetitions = 1
[arm]
effects = ["rotor"]
[sensing]
rate = 100.0
"""

ENVIRONMENT = """
[[box]]
name = "table"
size = [1.0, 1.0, 0.1]
xyz = [0.0, 0.0, -1.0]
rpy = [0.0, 0.0, 0.0]
[[sphere]]
name = "ball"
radius = 0.1
xyz = [2.0, 0.0, 0.0]
"""


def write_clean_inputs(folder: Path) -> None:
    """Writes a clean input of every kind, a run and a plan among them; takes about eight seconds."""
    from armid.dataclass_files import save
    from armid.study.storage.records import to_json
    from labs import small_plan, small_recording, write_arm, write_recording

    write_arm(folder)
    first, second = (small_recording(k, repetitions=1) for k in (1, 2))
    write_recording(first, folder / "log.csv")
    write_recording(second, folder / "other.csv")
    write_recording(first, folder / "table.npz")
    text = (folder / "log.csv").read_text()
    (folder / "log.txt").write_text(text.replace(",", " "))
    (folder / "log.csv.gz").write_bytes(gzip.compress(text.encode(), mtime=0))
    _write_arrays(folder)
    save(first, folder / "saved.npz")
    for name in ("arm.xacro", "arm.mjcf", "arm.toml"):
        shutil.copy(ROOT / "contract" / "arms" / name, folder / name)
    for name, content in (("study.toml", STUDY), ("lab.toml", LAB), ("environment.toml", ENVIRONMENT)):
        (folder / name).write_text(content)
    plan = small_plan(2)
    record = {"robot": "small", "joints": [f"joint_{j}" for j in (1, 2, 3)], "base_frequency": plan.base_frequency}
    record |= {"offset": plan.offset, "a": plan.a, "b": plan.b, "repetitions": 1, "begin": None, "end": None}
    record |= {"lead_in": 0.0, "lead_out": 0.0, "surroundings": [], "joint_limits": None}
    (folder / "plan.json").write_text(to_json(record))
    _write_motions(folder)
    write_servo_inputs(folder)
    _run(folder, "identify", "small.urdf", "log.csv", "--validate", "other.csv", "--out", "run")
    _run(folder, "payload", "run", "other.csv", "--out", "payload")
    _write_payload(folder / "payload" / "payload.json")
    _run(folder, "servo", "servo.xml", "servo.csv", "--columns", "effort=", "--no-report", "--out", "servo-run")
    write_fleet_inputs(folder, _run)
    (folder / "report.html").unlink(missing_ok=True)


def _write_payload(path: Path) -> None:
    """Writes a payload of 2 kg in place of the estimate that no payload was carried."""
    record = json.loads(path.read_text())
    record["warnings"] = []
    for each in record["parameters"]:
        value = {"M": 2.0, "MX": 0.0, "MY": 0.0, "MZ": 0.1}.get(
            each["name"], 0.02 if each["name"][0] in "XYZ" else 0.0
        )
        value = 0.0 if each["name"] in ("XY", "XZ", "YZ") else value
        each |= {"value": value, "unconstrained": value, "in_link": value, "status": "identified"}
    path.write_text(json.dumps(record))


def _write_arrays(folder: Path) -> None:
    """Writes the same recording in the formats that store arrays."""
    import kinds

    table = dict(np.load(folder / "table.npz"))
    kinds.write_npz(table, folder / "log.npz")
    kinds.write_mat(table, folder / "log.mat")
    kinds.write_mat73(table, folder / "log73.mat")
    kinds.write_parquet(table, folder / "log.parquet")
    kinds.write_excel(table, folder / "log.xlsx")
    for suffix in (".bag", ".db3", ".mcap"):
        kinds.write_bag(suffix)(table, folder / f"log{suffix}")


def _write_motions(folder: Path) -> None:
    """Writes the motion of the plan in the formats of controllers."""
    from armid.excitation.formats import FORMATS
    from armid.excitation.formats.sampled_motion import SampledMotion
    from labs import small_plan

    motion = SampledMotion("small", ("joint_1", "joint_2", "joint_3"), (False,) * 3, small_plan(2).sample(50.0))
    for name in ("csv", "ros2", "mat"):
        data = FORMATS[name].write(motion)
        (folder / f"plan{FORMATS[name].SUFFIX}").write_bytes(data.encode() if isinstance(data, str) else data)


def _run(folder: Path, *arguments: str) -> None:
    """Runs a command in a folder; raises an error if it refuses the clean input."""
    from armid.cli.main import main

    with (
        contextlib.chdir(folder),
        contextlib.redirect_stdout(io.StringIO()),
        contextlib.redirect_stderr(io.StringIO()) as said,
    ):
        try:
            main(list(arguments))
        except SystemExit as ended:
            if ended.code not in (0, 1, None):
                raise RuntimeError(f"{arguments}: {said.getvalue()}") from ended


def import_all() -> None:
    """Imports what the commands import later, so that each process of an attempt need not do it again."""
    import importlib
    import pkgutil

    import armid

    for module in pkgutil.walk_packages(armid.__path__, "armid."):
        with contextlib.suppress(ImportError):
            importlib.import_module(module.name)
    for name in (
        "scipy.io",
        "h5py",
        "pyarrow.parquet",
        "rosbags.highlevel",
        "xacro",
        "xacrodoc",
        "python_calamine",
        "rich.table",
    ):
        with contextlib.suppress(ImportError):
            importlib.import_module(name)
