"""Runs of commands on damaged inputs, each in a process of its own with limits of time and memory."""

from __future__ import annotations

import contextlib
import gc
import json
import math
import os
import re
import resource
import shutil
import signal
import sys
import tempfile
import time
import traceback
import warnings
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from zlib import crc32

import numpy as np
from kinds import KINDS, Command
from warm_start import warm_start

SECONDS = 30.0
"""CPU time after which a command counts as hung."""

STALLED = 120.0
"""Wall time after which a command counts as hung, even if it does not compute."""

MEMORY = 1.5e9
"""Resident memory above which a command on one of the small inputs fails [bytes]."""

ADDRESSES = 6_000_000_000
"""Limit of the address space of a command; beyond it, an allocation fails [bytes]."""

LARGEST_KEPT = 10_000_000
"""Size of a file above which it is not copied [bytes]."""

NEAR = 0.01
"""Relative difference of base parameters above which a result counts as another one than that of the clean input."""

FAILURES = ("traceback", "crash", "hang", "memory", "silent", "wrong")
"""Outcomes that are faults of armid."""

VALUE = ("value", "low", "high")
"""Keys of a parameter of a servo: value and ends of the 95 % interval."""

UNEXPECTED = 70
"""Exit code of the command line after an error that it did not expect."""


@dataclass(frozen=True, slots=True)
class Outcome:
    """Outcome of a command on a damaged input.

    Attributes:
        kind: Kind of input.
        seed: Seed of the damage.
        command: Name of the command.
        outcome: `ok`, `refused`, or one of `FAILURES`.
        detail: Place and text of an unexpected error, or the signal that ended the process.
        seconds: CPU time of the command [s].
        memory: Resident memory of the command [bytes].
    """

    kind: str
    seed: int
    command: str
    outcome: str
    detail: str = ""
    seconds: float = 0.0
    memory: float = 0.0


@dataclass(frozen=True, slots=True)
class Ended:
    """End of a process.

    Attributes:
        status: Exit code, or the negative number of the signal that ended it.
        out: Output.
        err: Messages.
        seconds: CPU time, of its own processes too [s].
        memory: Resident memory [bytes].
    """

    status: int
    out: str
    err: str
    seconds: float
    memory: float


@dataclass(frozen=True, slots=True)
class Answer:
    """Answer of an identification.

    Attributes:
        values: Value and 95 % interval of each parameter, by group of parameters with one unit, and name.
        codes: Severity and code of each finding.
    """

    values: dict[tuple[str, str], tuple[float, float, float]]
    codes: frozenset[str]


def attempts(
    name: str, seeds: range, clean: Path, keep: Path | None = None, *, every: bool = False
) -> Iterator[Outcome]:
    """Damages the input of a kind once for each seed, and runs a command that reads it, or all of them.

    Args:
        name: Kind of input.
        seeds: Seeds of the damages.
        clean: Folder of the clean inputs.
        keep: Folder to which inputs are copied that cause a failure; `None` to keep none.
        every: True if all commands that read the kind are run, false for one of them, chosen by the seed.
    """
    kind = KINDS[name]
    chosen_of = {seed: kind.commands if every else kind.commands[seed % len(kind.commands) :][:1] for seed in seeds}
    warm_start(clean, tuple(dict.fromkeys(command for chosen in chosen_of.values() for command in chosen)))
    gc.freeze()  # else the first collection in each process copies all memory
    for seed in seeds:
        with tempfile.TemporaryDirectory() as place:
            folder = Path(place) / "in"
            shutil.copytree(clean, folder, copy_function=os.link)
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                kind.damage(folder, np.random.default_rng([crc32(name.encode()), seed]))
            failed = False
            for command in chosen_of[seed]:
                ended = _in_child(_with_options(command, folder), folder)
                outcome, detail = _judged(name, command, ended, clean)
                failed |= outcome in FAILURES
                yield Outcome(name, seed, command[0], outcome, detail, ended.seconds, ended.memory)
            if failed and keep is not None:
                _keep(clean, folder, keep / f"{name}-{seed}")


def _keep(clean: Path, folder: Path, to: Path) -> None:
    """Copies the files that differ from the clean ones."""
    for path in folder.rglob("*"):
        twin = clean / path.relative_to(folder)
        if (
            path.is_file()
            and path.stat().st_size < 10_000_000
            and not (twin.is_file() and twin.stat().st_ino == path.stat().st_ino)
        ):
            (to / path.relative_to(folder)).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(path, to / path.relative_to(folder))


@cache
def _answer(name: str, clean: Path) -> Answer:
    """Answer of the identification to the clean input of a kind."""
    command = next(each for each in KINDS[name].commands if "--json" in each)
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place) / "in"
        shutil.copytree(clean, folder)
        ended = _in_child(command, folder)
        if ended.status != 0:
            raise RuntimeError(f"{command} fails on the clean input: {ended.err}")
        return _answered(ended.out, ended.err)


def _with_options(command: Command, folder: Path) -> Command:
    """Command with the options that a damage wrote."""
    options = folder / "options.json"
    return (*command, *json.loads(options.read_text())) if options.is_file() else command


def _judged(name: str, command: Command, ended: Ended, clean: Path) -> tuple[str, str]:
    """Outcome and detail of a command that has ended."""
    status, said = ended.status, ended.err.strip()
    if status in (-signal.SIGXCPU, -signal.SIGALRM):
        return "hang", " ".join(command)
    if status < 0:
        return "crash", f"{signal.Signals(-status).name} {' '.join(command)}"
    if ended.memory > MEMORY:
        return "memory", f"{ended.memory / 1e9:.1f} GB"
    if status == UNEXPECTED:
        return "traceback", said.splitlines()[-1].partition("; the trace is in")[0] if said else "?"
    if status not in (0, 1):
        return ("refused", "") if said or ended.out.strip() else ("silent", f"exit code {status}")
    if status == 0 and "--json" in command:
        return _compared(ended.out, ended.err, _answer(name, clean))
    return "ok", ""


def _codes(err: str) -> set[str]:
    """Severity and code of each finding among the messages of a command."""
    return set(re.findall(r"(?m)^(?:error|warning|info) [a-z-]+", err))


def _compared(out: str, err: str, expected: Answer) -> tuple[str, str]:
    """Compares the answer of an identification with that to the clean input.

    Servos of a short recording have wide intervals, so their values may also differ by what their intervals say.
    """
    found, truth = _answered(out, err), expected.values
    if found.codes - expected.codes:
        return "ok", ""
    if found.values.keys() != truth.keys():
        return "wrong", "other parameters, and no finding says so"
    norm = {group: math.sqrt(sum(truth[each][0] ** 2 for each in truth if each[0] == group)) for group, _ in truth}
    for name, (value, low, high) in found.values.items():
        right, least, most = truth[name]
        if abs(value - right) > NEAR * norm[name[0]] and not (least <= value <= most or low <= right <= high):
            return "wrong", f"{' '.join(name)} is {value:.4g}, not {right:.4g}, and no finding says so"
    return "ok", ""


def _answered(out: str, err: str) -> Answer:
    """Answer in the JSON of an identification; base parameters have no interval, so 1 % is allowed."""
    record = json.loads(out)
    if "base_parameters" in record:
        values = {("base", each["name"]): (each["value"], math.inf, -math.inf) for each in record["base_parameters"]}
    else:
        values = {
            (each["kind"], each["joint"]): tuple(math.nan if each[key] is None else each[key] for key in VALUE)
            for each in record["values"]
        }
    return Answer(values, frozenset(_codes(err)))


def _in_child(command: Command, folder: Path) -> Ended:
    """Runs a command in a process of its own."""
    out, err = folder.parent / "out", folder.parent / "err"
    sys.stdout.flush()
    sys.stderr.flush()
    child = os.fork()
    if not child:
        _be_child(command, folder, out, err)
    begin = time.monotonic()
    while True:
        done, state, used = os.wait4(child, os.WNOHANG)
        if done:
            break
        if time.monotonic() - begin > STALLED:
            os.kill(child, signal.SIGALRM)
        time.sleep(0.005)
    status = os.waitstatus_to_exitcode(state)
    said = (path.read_text(errors="replace") for path in (out, err))
    return Ended(status, *said, used.ru_utime + used.ru_stime, 1024.0 * used.ru_maxrss)


def _be_child(command: Command, folder: Path, out: Path, err: Path) -> None:
    """Runs a command in this process, and ends the process."""
    status = UNEXPECTED
    try:
        for path, stream in ((out, 1), (err, 2)):
            os.dup2(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_TRUNC), stream)
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        resource.setrlimit(resource.RLIMIT_CPU, (int(SECONDS), int(SECONDS) + 5))
        resource.setrlimit(resource.RLIMIT_AS, (ADDRESSES, ADDRESSES))
        signal.signal(signal.SIGALRM, signal.SIG_DFL)
        os.environ["ARMID_TRACES"] = str(folder.parent)
        os.chdir(folder)
        from armid.cli.main import main

        try:
            main(list(command))
            status = 0
        except SystemExit as ended:
            status = ended.code if isinstance(ended.code, int) else int(ended.code is not None)
        except BaseException as error:
            os.write(2, (f"\n{_place_of(error)}\n").encode("utf-8", "replace"))
        for stream in (sys.stdout, sys.stderr):
            with contextlib.suppress(Exception):
                stream.flush()
    finally:
        os._exit(status & 0xFF)


def _place_of(error: BaseException) -> str:
    """One line about an error: type, place in armid and place where it was raised."""
    frames = traceback.extract_tb(error.__traceback__)
    own = [frame for frame in frames if "/armid/" in frame.filename]
    places = [f"{Path(frame.filename).name}:{frame.lineno}" for frame in (*own[-1:], *frames[-1:])]
    return f"{type(error).__name__} at {' from '.join(dict.fromkeys(places))}: {' '.join(str(error).split())[:100]}"
