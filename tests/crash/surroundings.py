"""Commands in odd surroundings: names, streams, variables, limits, disks and other processes.

`python tests/crash/surroundings.py` runs all cases and prints their outcomes as JSON, with `--quick` without the slow
ones; `--page` prints the tables of the page docs/surroundings.md.
"""

from __future__ import annotations

import contextlib
import json
import os
import resource
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ.setdefault(name, "1")
for name in ("tests/crash", "tests/support"):
    sys.path.insert(0, str(ROOT / name))

from crash_child import Moment, run_disturbed  # noqa: E402
from crash_scenes import finish, state_of  # noqa: E402
from crash_scenes import write_inputs as write_scene  # noqa: E402

Place = Callable[[Path], object]

BYTES = os.fsdecode(b"caf\xe9")
"""A name that is not UTF-8."""

LONGEST_NAME = 255
"""Largest number of bytes of a name on usual file systems."""

NOBODY = 65534
"""Number of the user without rights."""

PREDICT = ("predict", "run")
SIMULATE = ("simulate", "small.urdf", "plan.json", "--options", "lab.toml")
TRACK = ("track", "run", "new.csv")
BASE = ("base", "small.urdf")
EXCITE = ("excite", "small.urdf", "--budget", "20", "--harmonics", "4", "--no-report", "--out", "plan")


def nothing(_: object) -> None:
    """Leaves all as it is."""


@dataclass(frozen=True, slots=True)
class Case:
    """A command in odd surroundings.

    Attributes:
        group: Heading of the table.
        name: The surroundings.
        command: Words of the command; it runs in a folder with a small arm, recordings, a plan and a run.
        code: Exit code.
        outcome: What happens, for the table.
        before: Function that prepares the folder.
        inside: Function that changes the process of the command.
        told: Text that the messages contain.
        after: Function that raises an error if the folder is not as it should be.
        fresh: Prefix of the command line of a new interpreter; empty for a copy of this process.
        shell: Redirections of a new interpreter.
        moment: Signal that is sent to the command.
        slow: True for a case that runs with the long tests only.
    """

    group: str
    name: str
    command: tuple[str, ...]
    code: int
    outcome: str
    before: Place = nothing
    inside: Callable[[], object] | None = None
    told: str = ""
    after: Place = nothing
    fresh: tuple[str, ...] = ()
    shell: str = ""
    moment: Moment = field(default_factory=Moment)
    slow: bool = False


# Preparations and checks ---------------------------------------------------------------------------------------


def copied_log(name: str) -> Place:
    """Preparation: the recording under another name."""
    return lambda folder: shutil.copy(folder / "new.csv", os.path.join(folder, name))


def loop(folder: Path) -> None:
    (folder / "loop.csv").symlink_to("loop.csv")


def exists(*names: str) -> Place:
    """Check that files exist."""

    def check(folder: Path) -> None:
        for name in names:
            assert (folder / name).exists(), f"{name!r} does not exist"
        assert not temporary(folder), temporary(folder)

    return check


def temporary(folder: Path) -> list[str]:
    """Temporary files in a folder and next to it."""
    found = [str(path.relative_to(folder)) for path in folder.rglob(".armid-*")]
    scratch = folder.parent / "tmp"
    return found + [name for name in (os.listdir(scratch) if scratch.is_dir() else ()) if name.startswith("armid-s")]


def clean(folder: Path) -> None:
    """Check that no temporary file is left."""
    assert not temporary(folder), temporary(folder)


def unchanged(name: str, made: Place) -> tuple[Place, Place]:
    """Preparation and check that something keeps its content."""

    def before(folder: Path) -> None:
        made(folder)
        (folder.parent / "kept.json").write_text(json.dumps(state_of(folder, (name,))))

    def after(folder: Path) -> None:
        assert state_of(folder, (name,)) == json.loads((folder.parent / "kept.json").read_text())
        clean(folder)

    return before, after


def earlier_track(folder: Path) -> None:
    """Preparation: a folder like that of an earlier `track`."""
    (folder / "moved").mkdir()
    (folder / "moved" / "track.json").write_text('{"earlier": true}')


def earlier_page(folder: Path) -> None:
    (folder / "page.html").write_text("<!doctype html>earlier")


def filled(folder: Path) -> None:
    (folder / "moved").mkdir()
    (folder / "moved" / "notes.txt").write_text("a file of the user")


def environment(**variables: str | None) -> Callable[[], None]:
    """Change of the process: variables, `None` to remove one."""

    def change() -> None:
        for name, value in variables.items():
            os.environ.pop(name, None)
            if value is not None:
                os.environ[name] = value

    return change


def limit(kind: int, number: int) -> Callable[[], None]:
    """Change of the process: a limit of a resource."""
    return lambda: resource.setrlimit(kind, (number, number))


def quota(size: int) -> Callable[[], None]:
    def change() -> None:
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        resource.setrlimit(resource.RLIMIT_FSIZE, (size, size))

    return change


def redirected(stream: int, to: str) -> Callable[[], None]:
    """Change of the process: a stream that goes to a device, or to a pipe without a reader."""

    def change() -> None:
        if to == "pipe":
            end, handle = os.pipe()
            os.close(end)
        else:
            handle = os.open(to, os.O_RDWR)
        os.dup2(handle, stream)

    return change


def without_rights() -> None:
    """Change of the process: a user without rights, where this one is the superuser."""
    if os.geteuid() == 0:
        os.setgroups([])
        os.setgid(NOBODY)
        os.setuid(NOBODY)


def old_clock() -> None:
    """Change of the process: a clock that began today at 1970."""
    began = time.monotonic()
    time.time = lambda: time.monotonic() - began


def vanishing(event: str, name: str) -> Callable[[], None]:
    """Change of the process: a folder vanishes at the first event of a kind that concerns a draft."""

    def change() -> None:
        gone: list[str] = []

        def hear(happened: str, arguments: tuple[object, ...]) -> None:
            if happened == event and ".draft" in str(arguments[0]) and not gone:
                gone.append(name)
                subprocess.run(["rm", "-rf", name], check=True)

        sys.addaudithook(hear)

    return change


def locked_by_another(folder: Path) -> None:
    """Preparation: another process writes the folder `moved`, as long as the case lasts."""
    ready, told = os.pipe()
    child = os.fork()
    if not child:
        from armid.output import locks

        with contextlib.suppress(BaseException):
            locks.start_claims("armid track")
            with locks.locked((folder / "moved").resolve()):
                os.write(told, b".")
                time.sleep(60.0)
        os._exit(0)
    os.read(ready, 1)
    _children.append(child)


_children: list[int] = []


def left_by_killed(folder: Path) -> None:
    """Preparation: what a process that was killed leaves."""
    from armid.output.locks import key_of

    key = key_of("moved")
    record = {"pid": 2**22 + 1, "host": socket.gethostname(), "command": "armid track", "since": "00:00:00"}
    (folder / f".armid-{key}.lock").write_text(json.dumps(record | {"target": b"moved".hex()}))
    (folder / f".armid-{key}.draft").mkdir()
    (folder / f".armid-{key}.draft" / "track.json").write_text("{")
    (folder / ".armid-abcdefgh.part").write_text("half")
    (folder.parent / "tmp" / "armid-scratch-x").mkdir(parents=True)


def between_renames(folder: Path) -> None:
    """Preparation: a process was killed between the two renames of a system that cannot exchange names."""
    from armid.output.locks import key_of

    left_by_killed(folder)
    (folder / f".armid-{key_of('moved')}.old").mkdir()
    (folder / f".armid-{key_of('moved')}.old" / "track.json").write_text('{"earlier": true}')


def between_files(folder: Path) -> None:
    """Preparation: a process was killed while it moved complete files into a folder with others."""
    commit = folder / "filled" / ".armid-files.commit"
    (commit / "new").mkdir(parents=True)
    (folder / "filled" / "notes.txt").write_text("a file of the user")
    (folder / "filled" / "noise-free.npz").write_text("earlier")
    (commit / "new" / "truth.json").write_text("new")
    (commit / "stale.json").write_text('["noise-free.npz"]')


def write_inputs(folder: Path) -> None:
    """Writes the folder in which the cases run."""
    write_scene(folder, former=False)
    shutil.rmtree(folder / "filled")
    for name in ("other.csv", "later.csv"):
        (folder / name).unlink()


def warm_up(inputs: Path, place: Path) -> None:
    """Loads what the commands need: a copy of this process without rights may not be able to read it."""
    import encodings.cp437  # noqa: F401

    shutil.copytree(inputs, place)
    for command in (
        (*TRACK, "--out", "moved"),
        (*SIMULATE, "--out", "lab"),
        (*PREDICT, "new.csv"),
        ("report", "run"),
        BASE,
    ):
        finish(place, command)


def cases() -> list[Case]:
    """All cases."""
    from surroundings_cases import CASES

    return CASES


def run_case(case: Case, inputs: Path, place: Path) -> str:
    """Runs a case; the reason why it fails, or an empty text."""
    folder = place / "work"
    shutil.copytree(inputs, folder)
    for path in (place, folder, *folder.rglob("*")):
        path.chmod(0o755)  # a user without rights may read it
    try:
        case.before(folder)
        code, said = _ended(case, folder)
        if code != case.code:
            return f"exit code {code} in place of {case.code}: {said[-300:]}"
        if "Traceback" in said or "Exception ignored" in said:
            return f"traceback: {said[-300:]}"
        if case.told not in " ".join(said.split()):
            return f"the messages do not contain {case.told!r}: {said[-300:]}"
        case.after(folder)
        return ""
    except AssertionError as error:
        return f"afterwards: {error}"
    finally:
        while _children:
            child = _children.pop()
            os.kill(child, signal.SIGKILL)
            os.waitpid(child, 0)
        for path in (folder, *folder.rglob("*")):
            if path.is_dir() and not path.is_symlink():
                path.chmod(0o755)
        shutil.rmtree(place)


def _ended(case: Case, folder: Path) -> tuple[int, str]:
    """Exit code and messages of the command of a case."""
    if not case.fresh and not case.shell:
        ended = run_disturbed(case.command, folder, case.moment, case.inside)
        if ended.left:
            return -1, f"{ended.left} processes are left"
        return ended.code, ended.err
    program = ["-c", "from armid.cli.entry import main; main()"]
    if case.fresh[:1] == ("env",):
        words = [*case.fresh, sys.executable, *program]
    else:
        words = [sys.executable, *case.fresh, *program]
    script = f'ulimit -c 0; "$@" {case.shell}'
    command = ["bash", "-c", script, "bash", *words, *case.command]
    done = subprocess.run(command, cwd=folder, capture_output=True, check=False, preexec_fn=case.inside)
    return done.returncode, done.stderr.decode("utf-8", "replace")


def table(chosen: list[Case]) -> str:
    """Table of the cases in Markdown."""
    lines: list[str] = []
    for group in dict.fromkeys(case.group for case in chosen):
        lines += [f"## {group}", "", "| surroundings | command | exit code | outcome |", "|---|---|---|---|"]
        lines += [f"| {c.name} | `{c.command[0]}` | {c.code} | {c.outcome} |" for c in chosen if c.group == group]
        lines.append("")
    return "\n".join(lines)


def main() -> None:
    """Runs all cases, or with `--quick` those that are not slow, and prints their outcomes."""
    if sys.argv[1:] == ["--page"]:
        sys.stdout.write(table(cases()))
        return
    with tempfile.TemporaryDirectory() as place:
        Path(place).chmod(0o755)
        os.environ["ARMID_CACHE"] = str(Path(place) / "cache")
        write_inputs(Path(place) / "inputs")
        warm_up(Path(place) / "inputs", Path(place) / "warm")
        found = {
            f"{case.group}: {case.name}": run_case(case, Path(place) / "inputs", Path(place) / "case")
            for case in cases()
            if not (case.slow and "--quick" in sys.argv)
        }
    sys.stdout.write(json.dumps(found, indent=1) + "\n")


if __name__ == "__main__":
    from surroundings import main as run  # the module that the table imports

    run()
