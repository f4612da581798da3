"""Kinds of input that the command line reads: a clean example, its mutators and the commands that read it."""

from __future__ import annotations

import gzip
import json
import shutil
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from array_mutators import Arrays, damage_arrays
from byte_mutators import damage_bytes, damage_text
from folder_mutators import arrays_of_hdf5, declare, lists_of_parquet, of_file, of_folder
from numpy.random import Generator
from numpy.typing import NDArray
from option_mutators import damage_options
from stored_mutators import archive_values, npz_declared, of_stored, with_new_digests
from tree_mutators import damage_json, damage_toml, damage_xml

Damage = Callable[[Path, Generator], None]
"""Function that damages the input in a folder with a clean one."""

Command = tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Kind:
    """Kind of input.

    Attributes:
        commands: Command lines that read the input, in the folder of the clean inputs.
        damage: Function that damages the input.
    """

    commands: tuple[Command, ...]
    damage: Damage


# Files ------------------------------------------------------------------------------------------------------------


def of_bytes(name: str) -> Damage:
    """Damage to the bytes of a file."""

    def damage(folder: Path, rng: Generator) -> None:
        _write(folder / name, damage_bytes((folder / name).read_bytes(), rng))

    return damage


def of_text(name: str) -> Damage:
    """Damage to the numbers, words and lines of a text file; sometimes to its bytes."""

    def damage(folder: Path, rng: Generator) -> None:
        path = folder / name
        if not rng.integers(5):
            return of_bytes(name)(folder, rng)
        return _write(path, damage_text(path.read_text(), rng).encode("utf-8", "replace"))

    return damage


def of_record(name: str, mutator: Callable[[str, Generator], bytes]) -> Damage:
    """Damage to a file of JSON, TOML or XML."""

    def damage(folder: Path, rng: Generator) -> None:
        _write(folder / name, mutator((folder / name).read_text(), rng))

    return damage


def of_arrays(name: str, writer: Callable[[Arrays, Path], None]) -> Damage:
    """Damage to the arrays that a file contains, or to its bytes."""

    def damage(folder: Path, rng: Generator) -> None:
        if not rng.integers(2):
            return of_bytes(name)(folder, rng)
        table = damage_arrays(dict(np.load(folder / "table.npz")), rng)
        (folder / name).unlink()
        try:
            writer(table, folder / name)
        except Exception:
            # The format cannot contain such arrays.
            _write(folder / name, b"")
        return None

    return damage


def _write(path: Path, data: bytes) -> None:
    """Writes a file anew; the clean file may be a hard link, so it is not overwritten."""
    path.unlink(missing_ok=True)
    path.write_bytes(data)


# Writers of arrays --------------------------------------------------------------------------------------------------


def write_npz(table: Arrays, path: Path) -> None:
    np.savez(path, **table)  # pyright: ignore[reportArgumentType]


def write_mat(table: Arrays, path: Path) -> None:
    import scipy.io

    scipy.io.savemat(path, table, do_compression=False)


def write_parquet(table: Arrays, path: Path) -> None:
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        pq.write_table(pa.table({name: pa.array(list(each)) for name, each in table.items()}), path)
    except pa.ArrowException as error:
        raise ValueError(str(error)) from error


def write_mat73(table: Arrays, path: Path) -> None:
    from recordings import write_v73

    write_v73(path, table)


def write_excel(table: Arrays, path: Path) -> None:
    from recordings import write_workbook

    write_workbook(path, {name: each.tolist() for name, each in table.items()})


def write_bag(suffix: str) -> Callable[[Arrays, Path], None]:
    """Writer of a bag, whose messages contain what the arrays contain."""

    def write(table: Arrays, path: Path) -> None:
        from recordings import write_bag

        time = np.nan_to_num(table["t"].astype(float).reshape(-1))
        count = len(time)
        messages = [
            {
                "stamp": int(np.clip(1.6e18 + 1e9 * time[i], 0, 2e18)),
                "name": ["joint_1", "joint_2", "joint_3"][: sum(name.startswith("q") for name in table)],
                **{
                    field: _row(table, short, i)
                    for field, short in (("position", "q"), ("velocity", "dq"), ("effort", "tau"))
                },
            }
            for i in range(min(count, 800))
        ]
        folder = path.with_name(f"bag_of_{path.name}")
        folder.mkdir()
        shutil.move(_write_messages(write_bag, folder, suffix, messages), path)
        shutil.rmtree(folder)

    return write


def _row(table: Arrays, short: str, i: int) -> NDArray[np.float64]:
    """Values of a quantity in one row of a table, without channels that are missing."""
    cells = [table[name][i : i + 1] for j in (1, 2, 3) if (name := f"{short}{j}") in table]
    return np.concatenate([np.zeros(0), *(np.asarray(cell, dtype=np.float64).reshape(-1) for cell in cells)])


def _write_messages(write_bag: Any, folder: Path, suffix: str, messages: list[dict[str, Any]]) -> Path:
    import recordings

    stamps, recordings.STAMPS = (
        recordings.STAMPS,
        1_600_000_000_000_000_000 + 10_000_000 * np.arange(len(messages) + 1),
    )
    try:
        return write_bag(folder, suffix, {"/joint_states": messages})
    finally:
        recordings.STAMPS = stamps


def in_archive(name: str, mutator: Callable[[Path, Generator], None]) -> Damage:
    """Damage to an archive of arrays."""

    def damage(folder: Path, rng: Generator) -> None:
        mutator(folder / name, rng)

    return damage


def any_of(*damages: Damage) -> Damage:
    """One of several damages."""

    def damage(folder: Path, rng: Generator) -> None:
        damages[int(rng.integers(len(damages)))](folder, rng)

    return damage


def every_motion(folder: Path, rng: Generator) -> None:
    """Damage to each of the motion files of a plan."""
    for damage in (of_text("plan.csv"), of_text("plan.trajectory.yaml"), of_bytes("plan.mat")):
        damage(folder, rng)


def run_folder(folder: Path, rng: Generator) -> None:
    """Damage to one of the files of a run."""
    files = sorted(path.name for path in (folder / "run").iterdir() if path.is_file())
    weights = np.array([3.0 if name in ("model.json", "robot.npz", "estimate.npz") else 1.0 for name in files])
    name = str(rng.choice(files, p=weights / weights.sum()))
    path = folder / "run" / name
    kind = rng.integers(8)
    if kind == 0:
        path.unlink()
    elif kind == 1:
        of_bytes(f"run/{name}")(folder, rng)
    elif name.endswith(".json"):
        of_record(f"run/{name}", damage_json)(folder, rng)
    elif name.endswith(".npz"):
        values = in_archive(f"run/{name}", archive_values)
        any_of(values, values, in_archive(f"run/{name}", npz_declared))(folder, rng)
    else:
        of_bytes(f"run/{name}")(folder, rng)


def compressed(folder: Path, rng: Generator) -> None:
    """Damage to a compressed text table, or a small file that unpacks to much."""
    if not rng.integers(12):
        rows = gzip.compress(b"1,2,3,4,5,6,7\n" * 300_000, 9)
        return _write(folder / "log.csv.gz", gzip.compress((folder / "log.csv").read_bytes()) + rows * 400)
    return of_bytes("log.csv.gz")(folder, rng)


def options(folder: Path, rng: Generator) -> None:
    """Options of a command with wrong values; the harness appends them to the command line."""
    (folder / "options.json").write_text(json.dumps(damage_options(rng)))


def recording(name: str, damage: Damage) -> Kind:
    """Kind of a recording, which the doctor and the identification read."""
    commands = (("doctor", "small.urdf", name), ("identify", "small.urdf", name, "--json", "--out", "new"))
    return Kind(commands, damage)


def description(name: str, mutator: Callable[[str, Generator], bytes]) -> Kind:
    """Kind of a description of a robot."""
    commands = (("base", name), ("preview", name, "--out", "page.html"), ("doctor", name, "log.csv"))
    return Kind(commands, of_record(name, mutator))


def servo(name: str, damage: Damage, *reading: str) -> Kind:
    """Kind of a recording with commands and without torque."""
    reading = ("--columns", "effort=", *reading)
    commands = (
        ("servo", "servo.xml", name, *reading, "--json", "--out", "new"),
        ("doctor", "servo.xml", name, *reading),
    )
    return Kind(commands, damage)


FEW_POSES = ("--experiment", "poses", "--poses", "3", "--rest", "0.5")
"""Options of the plan that is designed fastest."""


OF_RUNS: tuple[Command, ...] = (
    ("predict", "run", "log.csv"),
    ("validate", "run", "other.csv"),
    ("report", "run"),
    ("export", "run", "--to", "cpp", "--out", "exported"),
    ("certify", "run"),
    ("payload", "run", "other.csv"),
    ("track", "run", "other.csv"),
    ("monitor", "run", "other.csv"),
    ("recalibrate", "run", "other.csv", "--out", "again"),
    ("preview", "run", "other.csv", "--out", "page.html"),
)
"""Commands that read a run."""

WITH_FLEET = ("identify", "fleet/small.urdf", "fleet/unit-01.npz", "--fleet", "fleet/stored", "--out", "new-unit")
SINCE_FLEET = ("fleet", "fleet/LATER.toml", "--since", "fleet/stored", "--no-report", "--out", "new-fleet")

KINDS: dict[str, Kind] = {
    "csv": recording("log.csv", of_text("log.csv")),
    "text": recording("log.txt", of_text("log.txt")),
    "gzip": recording("log.csv.gz", compressed),
    "excel": recording("log.xlsx", of_arrays("log.xlsx", write_excel)),
    "npz": recording("log.npz", any_of(of_arrays("log.npz", write_npz), in_archive("log.npz", npz_declared))),
    "saved": recording(
        "saved.npz", any_of(*(in_archive("saved.npz", each) for each in (archive_values, npz_declared)))
    ),
    "mat": recording("log.mat", of_arrays("log.mat", write_mat)),
    "mat73": recording("log73.mat", of_arrays("log73.mat", write_mat73)),
    "parquet": recording("log.parquet", of_arrays("log.parquet", write_parquet)),
    "bag": recording("log.bag", of_arrays("log.bag", write_bag(".bag"))),
    "db3": recording("log.db3", of_arrays("log.db3", write_bag(".db3"))),
    "mcap": recording("log.mcap", of_arrays("log.mcap", write_bag(".mcap"))),
    "urdf": description("small.urdf", damage_xml),
    "xacro": description("arm.xacro", damage_xml),
    "mjcf": description("arm.mjcf", damage_xml),
    "dh": description("arm.toml", damage_toml),
    "study": Kind(
        (("doctor", "study.toml"), ("identify", "study.toml", "--out", "new")),
        of_record("study.toml", damage_toml),
    ),
    "plan": Kind(
        (
            ("predict", "run", "plan.json"),
            ("simulate", "small.urdf", "plan.json", "--mode", "inverse-dynamics", "--out", "sim"),
            ("preview", "small.urdf", "plan.json", "--out", "page.html"),
        ),
        of_record("plan.json", damage_json),
    ),
    "motion": Kind(
        (("predict", "run", "plan.csv"), ("predict", "run", "plan.trajectory.yaml"), ("predict", "run", "plan.mat")),
        every_motion,
    ),
    "run": Kind(OF_RUNS, run_folder),
    "run-digests": Kind(OF_RUNS, with_new_digests("run", "model.json", "robot.npz", "estimate.npz")),
    "lab": Kind(
        (("simulate", "small.urdf", "plan.json", "--options", "lab.toml", "--out", "sim"),),
        of_record("lab.toml", damage_toml),
    ),
    "environment": Kind(
        (("preview", "small.urdf", "plan.json", "--environment", "environment.toml", "--out", "page.html"),),
        of_record("environment.toml", damage_toml),
    ),
    "payload": Kind(
        (("payload", "payload/payload.json", "--to", "ur"),), of_record("payload/payload.json", damage_json)
    ),
    "mcap-sizes": recording("log.mcap", of_file("log.mcap", declare, declare, declare)),
    "servo-csv": servo("servo.csv", of_text("servo.csv")),
    "lerobot": servo("lerobot", of_folder("lerobot", lists_of_parquet), "--units", "rad"),
    "aloha": servo("episode.hdf5", of_file("episode.hdf5", arrays_of_hdf5), "--rate", "50"),
    "sage": servo("sage", of_folder("sage")),
    "bag-folder": servo("bag", of_folder("bag")),
    "servo-study": Kind((("servo", "servo.toml", "--out", "new"),), of_record("servo.toml", damage_toml)),
    "servo-stored": Kind(
        (
            ("report", "servo-run"),
            ("validate", "servo-run", "servo-other.csv", "--columns", "effort="),
            ("preview", "servo-run", "servo.csv", "--out", "page.html"),
        ),
        of_stored("servo-run", "servo.json", "robot.npz"),
    ),
    "servo-mjcf": Kind(
        (
            ("servo", "servo.xml", "servo.csv", "--out", "new"),
            ("base", "servo.xml"),
            ("preview", "servo.xml", "--out", "page.html"),
        ),
        of_record("servo.xml", damage_xml),
    ),
    "srdf": Kind(
        (("excite", "small.urdf", "--srdf", "small.srdf", *FEW_POSES, "--out", "planned"),),
        of_record("small.srdf", damage_xml),
    ),
    "options": Kind((("doctor", "small.urdf", "log.csv"), ("predict", "run", "log.csv")), options),
    "fleet": Kind((("fleet", "fleet/FLEET.toml", "--out", "new"),), of_record("fleet/FLEET.toml", damage_toml)),
    "fleet-stored": Kind(
        ((*WITH_FLEET, "--json"), SINCE_FLEET),
        of_stored(
            "fleet/stored",
            "fleet.json",
            "fleet.npz",
            "robot.npz",
            *(f"units/unit-01/{name}" for name in ("model.json", "estimate.npz", "robot.npz", "validation.json")),
        ),
    ),
    "fleet-digests": Kind(
        (WITH_FLEET, SINCE_FLEET), with_new_digests("fleet/stored", "fleet.json", "fleet.npz", "robot.npz")
    ),
}
"""Kinds of input by name."""
