"""Commands that replace an earlier result, each with its inputs, for the tests that kill them."""

from __future__ import annotations

import contextlib
import io
import shutil
import zipfile
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path

Command = tuple[str, ...]
State = dict[str, str]

TEMPORARY = ".armid-"
"""Beginning of the names of temporary files."""

LAB = 'mode = "inverse-dynamics"\nrepetitions = 1\n[arm]\neffects = ["rotor"]\n[sensing]\nrate = 100.0\n'


@dataclass(frozen=True, slots=True)
class Scene:
    """A command that replaces the result of another one.

    Attributes:
        name: Name of the command.
        results: Paths of the result, relative to the working folder.
        first: The command that made the earlier result.
        second: The command that replaces it.
        later: Names of files without which the result is complete, too.
        journal: True if the result lies among other files, so that the next run may have to complete it.
    """

    name: str
    results: tuple[str, ...]
    first: Command
    second: Command
    later: tuple[str, ...] = ()
    journal: bool = False


TERMS = ("--terms", "rigid-body,viscous")
EXCITE = ("excite", "small.urdf", "--budget", "0.3", "--harmonics", "4", "--duration", "6", "--out", "plan")
PAGES = ("preflight.html", "preview.html")
SIDE = "run/small.xml.armid.json"

SCENES = {
    scene.name: scene
    for scene in (
        Scene(
            "identify",
            ("again",),
            ("identify", "small.urdf", "log.csv", "--validate", "other.csv", *TERMS, "--out", "again"),
            ("identify", "small.urdf", "log.csv", "--validate", "other.csv", "--method", "ols", "--out", "again"),
            ("report.html",),
        ),
        Scene("excite", ("plan",), (*EXCITE, "--workers", "0"), (*EXCITE, "--workers", "2", "--seed", "2"), PAGES),
        Scene(
            "simulate",
            ("lab",),
            ("simulate", "small.urdf", "plan.json", "--options", "lab.toml", "--out", "lab"),
            ("simulate", "small.urdf", "plan.json", "--options", "lab.toml", "--seed", "2", "--out", "lab"),
        ),
        Scene(
            "simulate among others",
            tuple(f"filled/{name}" for name in ("recording.csv", "truth.json", "noise-free.npz")),
            ("simulate", "small.urdf", "plan.json", "--options", "lab.toml", "--noise-free", "--out", "filled"),
            ("simulate", "small.urdf", "plan.json", "--options", "lab.toml", "--seed", "2", "--out", "filled"),
            journal=True,
        ),
        Scene(
            "export",
            ("run/small.xml", SIDE),
            ("export", "run", "--to", "mjcf", "--nearest", "--limit", "joint_1.effort=50"),
            ("export", "run", "--to", "mjcf", "--nearest", "--limit", "joint_1.effort=60"),
            journal=True,
        ),
        Scene(
            "report",
            ("run/report.html",),
            ("report", "former", "run", "--out", "run/report.html"),
            ("report", "run"),
        ),
        Scene(
            "payload",
            ("load",),
            ("payload", "run", "new.csv", "--out", "load"),
            ("payload", "run", "later.csv", "--out", "load"),
        ),
        Scene(
            "track",
            ("moved",),
            ("track", "run", "new.csv", "--out", "moved"),
            ("track", "run", "new.csv", "--memory", "5", "--out", "moved"),
        ),
    )
}


def write_inputs(folder: Path, *, former: bool = True) -> None:
    """Writes the inputs of all commands, a run among them, and another run, if asked for."""
    from armid.study.storage.records import to_json
    from labs import small_plan, small_recording, write_arm, write_recording

    folder.mkdir(parents=True)
    write_arm(folder)
    for seed, name in ((1, "log.csv"), (2, "other.csv"), (3, "new.csv"), (4, "later.csv")):
        write_recording(small_recording(seed, repetitions=1), folder / name)
    (folder / "lab.toml").write_text(LAB)
    plan = small_plan(2)
    record = {"robot": "small", "joints": [f"joint_{j}" for j in (1, 2, 3)], "base_frequency": plan.base_frequency}
    record |= {"offset": plan.offset, "a": plan.a, "b": plan.b, "repetitions": 1, "begin": None, "end": None}
    record |= {"lead_in": 0.0, "lead_out": 0.0, "surroundings": [], "joint_limits": None}
    (folder / "plan.json").write_text(to_json(record))
    (folder / "filled").mkdir()
    (folder / "filled" / "notes.txt").write_text("a file of the user\n")
    arguments = ("identify", "small.urdf", "log.csv", "--validate", "other.csv")
    finish(folder, (*arguments, "--no-report", "--out", "run"))
    if former:
        finish(folder, (*arguments, "--no-report", *TERMS, "--out", "former"))


def finish(folder: Path, command: Command) -> None:
    """Runs a command in a folder to its end; raises an error if it is refused."""
    from armid.cli.main import main

    with (
        contextlib.chdir(folder),
        contextlib.redirect_stdout(io.StringIO()),
        contextlib.redirect_stderr(io.StringIO()) as said,
    ):
        try:
            main(list(command))
        except SystemExit as ended:
            if ended.code not in (0, 1, None):
                raise RuntimeError(f"{command}: {said.getvalue()}") from ended


def state_of(folder: Path, results: tuple[str, ...]) -> State:
    """Digest of each file of a result, by its path; temporary files are left out."""
    found: State = {}
    for result in results:
        path = folder / result
        for each in (path, *(path.rglob("*") if path.is_dir() else ())):
            if each.is_file() and not any(part.startswith(TEMPORARY) for part in each.relative_to(folder).parts):
                found[str(each.relative_to(folder))] = sha256(each.read_bytes()).hexdigest()
    return found


def everything(folder: Path) -> set[str]:
    """Paths of all files and folders."""
    return {str(path.relative_to(folder)) for path in folder.rglob("*")}


def judged(scene: Scene, folder: Path, before: State, clean: State) -> str:
    """Kind of the result in a folder: `old`, `new`, `pending`, `lost` or `mixed`.

    Args:
        scene: The command.
        folder: Working folder of the command.
        before: The earlier result.
        clean: A result of the command that was not disturbed.
    """
    found = state_of(folder, scene.results)
    if found == before:
        return "old"
    optional = {path for path in clean if Path(path).name in scene.later}
    whole = clean.keys() - optional <= found.keys() <= clean.keys()
    changing = {path for path in clean if before.get(path) != clean[path]}
    if whole and all(found.get(path) != before.get(path) for path in changing - optional):
        return "new" if loads(folder, found) else "mixed"
    if scene.journal and list(folder.rglob(".armid-files.commit")):
        return "pending"
    return "mixed" if found else "lost"


def loads(folder: Path, state: State) -> bool:
    """True if archives and records of a result can be read, and a run fits together."""
    import json

    from armid.errors import ArmidError
    from armid.runs.run import load_run

    try:
        for name in state:
            path = folder / name
            if path.suffix == ".json":
                json.loads(path.read_text())
            elif path.suffix == ".npz" and zipfile.ZipFile(path).testzip() is not None:
                return False
            if path.name == "estimate.json":
                load_run(path.parent)
    except (ValueError, OSError, ArmidError, zipfile.BadZipFile):
        return False
    return True


def copied(source: Path, target: Path) -> Path:
    """Copy of a folder; unlike a link, a file of it cannot be changed by way of another copy."""
    shutil.copytree(source, target)
    return target
