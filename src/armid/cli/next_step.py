"""Answer of `armid` alone: what to do next, by what lies in the working folder."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

__all__ = ["DESCRIPTIONS", "next_step"]

DESCRIPTIONS = (".urdf", ".xacro", ".xml", ".mjcf")
TEXT = (".csv", ".tsv", ".txt", ".dat", ".asc", ".log")
RECORDINGS = (
    *TEXT,
    *(".parquet", ".pq", ".npz", ".mat", ".bag", ".db3", ".mcap", ".xlsx", ".xlsm"),
    *(f"{text}{packed}" for text in TEXT for packed in (".gz", ".xz", ".bz2", ".zst")),
    *(".bag.zstd", ".db3.zstd", ".mcap.zstd"),
)
"""Endings that readers know; a test compares them, because to import the readers takes NumPy."""

VAGUE = (".txt", ".log", ".dat", ".asc")
"""Endings that recordings have, and much else: files with another go first."""

BEGIN = (
    ("armid demo", "the whole job on a virtual arm, half a minute"),
    ("armid base ROBOT", "what the torques of your arm can show"),
    ("armid excite ROBOT", "the motion to record"),
    ("armid doctor ROBOT RECORDING", "whether a log can be trusted"),
    ("armid identify ROBOT RECORDING --validate OTHER", "a model, checked on motion that it has not seen"),
)


def next_step(folder: Path | str = ".") -> str:
    """The next command for a folder, most finished work first: a run, a study, an arm with recordings, an arm.

    Args:
        folder: Where to look.
    """
    steps = _steps(Path(folder)) or BEGIN
    width = max(len(command) for command, _ in steps)
    lines = ["armid finds the dynamic model of a robot arm. Next, for instance:", ""]
    lines += [f"  {command:{width}}   {what}" for command, what in steps]
    return "\n".join([*lines, "", "armid --help lists all commands, armid COMMAND --help has examples."]) + "\n"


def _steps(folder: Path) -> tuple[tuple[str, str], ...]:
    """Commands that suit what lies in a folder; none where nothing does."""
    files = sorted(path.name for path in folder.iterdir() if path.is_file())
    runs = [path.parent for path in folder.glob("runs/*/estimate.json")]
    if runs:
        run = max(runs, key=lambda path: (path / "estimate.json").stat().st_mtime).relative_to(folder)
        return (
            (f"armid report {run}", "a page about the latest run"),
            (f"armid validate {run} RECORDING", "its error on motion that it has not seen"),
            (f"armid export {run} --to urdf", "the model written back, or as source code: --to c"),
        )
    arms = [name for name in files if name.endswith(DESCRIPTIONS)]
    if "study.toml" in files:
        return ("armid doctor study.toml", "what is wrong with the logs"), ("armid identify study.toml", "a model")
    logs = _logs(folder, files)
    if arms and logs:
        return (
            (f"armid doctor {arms[0]} {logs[0]}", "what is wrong with the log"),
            (f"armid identify {arms[0]} {logs[0]}", "a model; keep a recording for --validate"),
        )
    if arms:
        return (
            (f"armid base {arms[0]}", "what its torques can show"),
            (f"armid excite {arms[0]}", "the motion to record"),
        )
    return ()


def _logs(folder: Path, files: Sequence[str]) -> list[str]:
    """Recordings in a folder, those of which the name is sure first: files, and folders of ROS bags."""
    known = [name for name in files if name.lower().endswith(RECORDINGS)]
    bags = sorted(path.parent.name for path in folder.glob("*/metadata.yaml"))
    return [*sorted(known, key=lambda name: name.lower().endswith(VAGUE)), *bags]
