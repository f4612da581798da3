"""Moments at which commands are killed or their disk is full, and the checks afterwards."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from crash_child import Ended, Moment, run_disturbed
from crash_scenes import SCENES, TEMPORARY, Scene, State, copied, everything, finish, judged, state_of, write_inputs

UNEXPECTED = 70
"""Exit code of the command line after an error that it did not expect."""

DONE = (0, 1)
"""Exit codes of a command that wrote its result; 1 for a verdict that failed."""

STOPS = (("SIGTERM", 143, "terminated"), ("SIGINT", 130, "interrupted"))
"""Signals that end a command cleanly, its exit code and the beginning of its message."""

STARTED = 0.02
"""Time after which a process has begun to handle signals [s]; it is forked, so it loads nothing."""

PAGE, LARGE = 4096, 64 << 20
"""Page of memory, in which files of a small disk are counted, and its size before it is filled [bytes]."""


@dataclass(frozen=True, slots=True)
class Outcome:
    """Outcome of a moment: the command, the disturbance, the kind of the result, and the names of failed checks."""

    scene: str
    kind: str
    moment: str
    result: str
    faults: tuple[str, ...]
    detail: str = ""


@dataclass(frozen=True, slots=True)
class Prepared:
    """A command with its inputs and an earlier result.

    Attributes:
        scene: The command.
        folder: Folder of the inputs and the earlier result.
        before: The earlier result.
        clean: Result of the command that was not disturbed.
        paths: Paths of all files after that.
        seconds: Time that the command takes [s].
        changes: Number of changes of the disk.
        full: Number of changes of the disk that can fail.
    """

    scene: Scene
    folder: Path
    before: State
    clean: State
    paths: frozenset[str]
    seconds: float
    changes: int
    full: int


class Moments:
    """Disturbances of commands in folders below a given place."""

    def __init__(self, place: Path, seed: int, names: Sequence[str]) -> None:
        self._place = place
        self._rng = np.random.default_rng(seed)
        write_inputs(place / "inputs")
        self._prepared = [self._prepare(SCENES[name]) for name in names]

    def all(self, moments: int, full: int) -> Iterator[Outcome]:
        """Kills commands in turn, half of them at random times and half at changes of the disk; then fills disks.

        Args:
            moments: Number of kills.
            full: Number of full disks.
        """
        for number in range(moments):
            prepared = self._prepared[number % len(self._prepared)]
            if (number // len(self._prepared)) % 2:
                moment = Moment(after=float(self._rng.uniform(0.0, prepared.seconds)))
            else:
                moment = Moment(at=int(self._rng.integers(1, prepared.changes + 1)))
            yield self._killed(prepared, moment)
        positions = [(each, at) for each in self._prepared for at in range(1, each.full + 1)]
        if full < len(positions):
            positions = [positions[k] for k in sorted(self._rng.choice(len(positions), full, replace=False))]
        for prepared, at in positions:
            yield self._full(prepared, Moment(at=at, full=True))

    def every(self) -> Iterator[Outcome]:
        """Kills each command before each of its changes of the disk."""
        for prepared in self._prepared:
            for at in range(1, prepared.changes + 1):
                yield self._killed(prepared, Moment(at=at))

    def stopped(self, count: int) -> Iterator[Outcome]:
        """Commands in turn that are ended by SIGTERM or by Ctrl-C at random times.

        Args:
            count: Number of ends.
        """
        for number in range(count):
            prepared = self._prepared[number % len(self._prepared)]
            name, code, word = STOPS[(number // len(self._prepared)) % len(STOPS)]
            after = float(self._rng.uniform(STARTED, prepared.seconds))
            place = self._place / "moment"
            folder = copied(prepared.folder, place / "work")
            ended = run_disturbed(prepared.scene.second, folder, Moment(after=after, by=signal.Signals[name]))
            result = judged(prepared.scene, folder, prepared.before, prepared.clean)
            faults = [result] if result not in ("old", "new") else []
            faults += ["processes"] if ended.left else []
            lines = [line for line in ended.err.splitlines() if line.startswith(word)]
            told = ended.code == code and len(lines) == 1 and ("nothing was written" in lines[0]) == (result == "old")
            faults += [] if told or ended.code in DONE else ["message"]
            left = _leftovers(folder, prepared)
            faults += ["leftovers"] if left else []
            shutil.rmtree(place)
            detail = f"{ended.code} {sorted(left)[:3]} {ended.err.strip()[-200:]}"
            yield Outcome(prepared.scene.name, name, f"{after:.3f}", result, tuple(faults), detail)

    def quotas(self, count: int) -> Iterator[Outcome]:
        """Commands whose files may have a largest size only, as with a quota."""
        for prepared in self._prepared:
            largest = max((prepared.folder / path).stat().st_size for path in prepared.before)
            for share in np.linspace(0.0, 0.95, count):
                yield self._full(prepared, Moment(largest=max(PAGE, int(share * largest))))

    def small_disks(self, count: int) -> Iterator[Outcome]:
        """Commands on file systems with too little space; the superuser of Linux alone can mount them."""
        for prepared in self._prepared:
            need = sum((prepared.folder / path).stat().st_size + PAGE for path in prepared.before)
            for free in np.linspace(0, need, count).astype(int):
                yield self._on_small_disk(prepared, int(free) // PAGE)

    def _prepare(self, scene: Scene) -> Prepared:
        """Makes the earlier result of a command, and its new result in a copy."""
        folder = copied(self._place / "inputs", self._place / scene.name / "work")
        finish(folder, scene.first)
        copy = copied(folder, self._place / scene.name / "clean" / "work")
        ended = run_disturbed(scene.second, copy)
        if ended.code not in DONE:
            raise RuntimeError(f"{scene.second}: {ended.err}")
        clean, paths = state_of(copy, scene.results), frozenset(everything(copy))
        again = copied(folder, self._place / scene.name / "again" / "work")
        full = run_disturbed(scene.second, again, Moment(full=True)).changes
        before = state_of(folder, scene.results)
        return Prepared(scene, folder, before, clean, paths, ended.seconds, ended.changes, full)

    def _killed(self, prepared: Prepared, moment: Moment) -> Outcome:
        """Kills a command, and runs it again."""
        scene, place = prepared.scene, self._place / "moment"
        folder = copied(prepared.folder, place / "work")
        ended = run_disturbed(scene.second, folder, moment)
        result = judged(scene, folder, prepared.before, prepared.clean)
        faults = [result] if result in ("lost", "mixed") else []
        faults += ["processes"] if ended.left else []
        finish_again = run_disturbed(scene.second, folder)
        after = judged(scene, folder, prepared.before, prepared.clean)
        if finish_again.code not in DONE or after not in ("new", "old"):
            faults.append("message")
        left = _leftovers(folder, prepared)
        faults += ["leftovers"] if left else []
        detail = f"{sorted(left)[:3]} {finish_again.err.strip()[-200:] if 'message' in faults else ''}"
        shutil.rmtree(place)
        kind = "killed" if moment.at is None else "killed at"
        return Outcome(scene.name, kind, f"{moment.after or moment.at}", result, tuple(faults), detail)

    def _full(self, prepared: Prepared, moment: Moment) -> Outcome:
        """Runs a command whose disk is full at a moment."""
        scene, place = prepared.scene, self._place / "moment"
        folder = copied(prepared.folder, place / "work")
        ended = run_disturbed(scene.second, folder, moment)
        outcome = self._judged(prepared, folder, ended, "full" if moment.full else "quota", f"{moment.at}")
        shutil.rmtree(place)
        return outcome

    def _on_small_disk(self, prepared: Prepared, pages: int) -> Outcome:
        """Runs a command on a file system on which a number of pages is free."""
        place = self._place / "moment"
        disk = place / "disk"
        disk.mkdir(parents=True)
        subprocess.run(["mount", "-t", "tmpfs", "-o", f"size={LARGE}", "tmpfs", disk], check=True)
        try:
            folder = copied(prepared.folder, disk / "work")
            free = os.statvfs(disk).f_bavail
            (disk / "filler").write_bytes(bytes((free - pages) * os.statvfs(disk).f_bsize))
            link = place / "work"
            link.symlink_to(folder)
            ended = run_disturbed(prepared.scene.second, link)
            return self._judged(prepared, folder, ended, "small disk", f"{pages}")
        finally:
            subprocess.run(["umount", "-l", disk], check=True)
            shutil.rmtree(place)

    def _judged(self, prepared: Prepared, folder: Path, ended: Ended, kind: str, moment: str) -> Outcome:
        """Outcome of a command whose disk was full: it says so once, or it succeeded."""
        result = judged(prepared.scene, folder, prepared.before, prepared.clean)
        faults = [result] if result not in ("old", "new") else []
        faults += ["processes"] if ended.left else []
        said = ended.err.strip()
        if ended.code == 2:
            good = result == "old" and said.count("error ") == 1
        else:
            good = ended.code in DONE
        if not good or "Traceback" in said:
            faults.append("message")
        left = _leftovers(folder, prepared)
        faults += ["leftovers"] if left else []
        detail = f"{ended.code} {sorted(left)[:3]} {said[-300:]}"
        return Outcome(prepared.scene.name, kind, moment, result, tuple(faults), detail)


def _leftovers(folder: Path, prepared: Prepared) -> set[str]:
    """Files that neither the inputs nor a result have, and temporary files elsewhere."""
    found = everything(folder) - prepared.paths - everything(prepared.folder)
    scratch = folder.parent / "tmp"
    found |= {name for name in (os.listdir(scratch) if scratch.is_dir() else ()) if name.startswith("armid-scratch")}
    return found | {path.name for path in folder.parent.glob(f"{TEMPORARY}*")}
