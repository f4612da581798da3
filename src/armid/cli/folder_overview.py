"""Output of `armid` without a command: next commands for the files in the working folder."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from pathlib import Path

from armid.measurement.catalogue import READERS, recording_endings

DESCRIPTIONS = (".urdf", ".xacro", ".xml", ".mjcf")
"""Suffixes of robot descriptions. They are copied, because the import of the readers would load NumPy; a test
compares them with the readers."""

BEGIN = (
    ("armid demo", "a complete identification on a virtual arm, half a minute"),
    ("armid base ROBOT", "the parameters that the torques of your arm determine"),
    ("armid excite ROBOT", "design of the motion to record"),
    ("armid doctor ROBOT RECORDING", "check of a recording for faults"),
    ("armid identify ROBOT RECORDING --validate OTHER", "a model, validated on a held-out recording"),
)


def next_step(folder: Path | str = ".") -> str:
    """Next commands for the latest run in a folder, or else for its study, or else for its arm and recordings.

    Args:
        folder: Folder to examine.
    """
    steps = _steps(Path(folder)) or BEGIN
    width = max(len(command) for command, _ in steps)
    lines = ["armid finds the dynamic model of a robot arm. Next, for instance:", ""]
    lines += [f"  {command:{width}}   {purpose}" for command, purpose in steps]
    return "\n".join([*lines, "", "armid --help lists all commands, armid COMMAND --help has examples."]) + "\n"


def _steps(folder: Path) -> tuple[tuple[str, str], ...]:
    """Commands for the files in a folder, each with its purpose; empty if no file is known."""
    files = sorted(path.name for path in folder.iterdir() if path.is_file())
    runs = [*folder.glob("runs/*/estimate.json"), *folder.glob("runs/*/servo.json")]
    if runs:
        newest = max(runs, key=lambda path: path.stat().st_mtime)
        run = shlex.quote(str(newest.parent.relative_to(folder)))
        if newest.name == "servo.json":
            return (
                (f"armid report {run}", "a page about the latest servos"),
                (f"armid validate {run} RECORDING", "position error of the closed loop on a held-out recording"),
                (f"armid preview {run}", "a page on which the arm moves through a recording"),
            )
        return (
            (f"armid report {run}", "a page about the latest run"),
            (f"armid validate {run} RECORDING", "torque error of the run on a held-out recording"),
            (f"armid export {run} --to c", "the model as source code; --to urdf for a robot description"),
        )
    arms = [shlex.quote(name) for name in files if name.endswith(DESCRIPTIONS)]
    if "study.toml" in files:
        return ("armid doctor study.toml", "check of the recordings for faults"), (
            "armid identify study.toml",
            "a model",
        )
    logs = [shlex.quote(name) for name in _logs(folder, files)]
    if arms and logs:
        return (
            (f"armid doctor {arms[0]} {logs[0]}", "check of the recording for faults"),
            (
                f"armid identify {arms[0]} {logs[0]}",
                "a model; to validate it, give a further recording with --validate",
            ),
        )
    if arms:
        return (
            (f"armid base {arms[0]}", "the parameters that the torques of the arm determine"),
            (f"armid excite {arms[0]}", "design of the motion to record"),
        )
    return ()


def _logs(folder: Path, files: Sequence[str]) -> list[str]:
    """Names of the recordings in a folder: files with a clear suffix, files with an ambiguous one, then folders."""
    known = [name for name in files if name.lower().endswith(recording_endings())]
    ambiguous = tuple(suffix for each in READERS.values() for suffix in each.ambiguous)
    marks = ["metadata.yaml", *(each.folder[0] for each in READERS.values() if each.folder)]
    folders = sorted({path.relative_to(folder).parts[0] for mark in marks for path in folder.glob(f"*/{mark}")})
    return [*sorted(known, key=lambda name: name.lower().endswith(ambiguous)), *folders]
