"""Table of the cases of `surroundings`."""

from __future__ import annotations

import os
import resource
import shutil
import signal
from dataclasses import replace
from pathlib import Path

from crash_child import Moment
from surroundings import (
    BASE,
    BYTES,
    EXCITE,
    LONGEST_NAME,
    PREDICT,
    SIMULATE,
    TRACK,
    Case,
    between_files,
    between_renames,
    clean,
    copied_log,
    earlier_page,
    earlier_track,
    environment,
    exists,
    filled,
    left_by_killed,
    limit,
    locked_by_another,
    loop,
    old_clock,
    quota,
    redirected,
    unchanged,
    vanishing,
    without_rights,
)

READ, REFUSED, WRITTEN, KEPT = "read", "one error", "written", "one error; the earlier result is kept"
FILE = f"{'n' * (LONGEST_NAME - 4)}.csv"


def named(title: str, name: str, code: int = 0, *, before: object = None, told: str = "") -> Case:
    """Case of a recording with a name."""
    outcome = READ if code == 0 else REFUSED
    made = copied_log(name) if before is None else before
    return Case("Names of inputs", title, (*PREDICT, name), code, outcome, made, told=told, after=clean)


def link(name: str, to: str):
    return lambda folder: (folder / name).symlink_to(to)


def outside(
    title: str, out: str, code: int = 0, *, before: object = None, told: str = "", after: object = None
) -> Case:
    """Case of a folder for output."""
    outcome = WRITTEN if code == 0 else REFUSED
    check = after or (exists(f"{out}/recording.csv") if code == 0 else clean)
    made = before or (lambda folder: None)
    command = (*SIMULATE, f"--out={out}")
    return Case("Names of outputs", title, command, code, outcome, made, told=told, after=check)


def kept(title: str, inside: object, told: str, **more: object) -> Case:
    """Case of a disk that takes nothing; the earlier folder stays."""
    before, after = unchanged("moved", earlier_track)
    command = (*TRACK, "--out", "moved")
    return Case("Disks", title, command, 2, KEPT, before, inside, told, after, **more)


def under(title: str, inside: object, code: int = 0, outcome: str = "done", told: str = "") -> Case:
    """Case of a process with other variables or limits."""
    command = (*SIMULATE, "--out", "lab")
    check = exists("lab/recording.csv") if code == 0 else clean
    return Case("Variables and limits", title, command, code, outcome, inside=inside, told=told, after=check)


def fresh(title: str, *prefix: str, command: tuple[str, ...] = BASE, outcome: str = "done", **more: object) -> Case:
    """Case of a new interpreter."""
    return Case("Variables and limits", title, command, 0, outcome, fresh=prefix, **more)


def stream(
    title: str, inside: object, code: int, outcome: str, command: tuple[str, ...] = BASE, told: str = ""
) -> Case:
    """Case of a standard stream."""
    return Case("Standard streams", title, command, code, outcome, inside=inside, told=told)


def closed(title: str, shell: str, *, slow: bool = True) -> Case:
    """Case of closed streams of a new interpreter."""
    return Case("Standard streams", title, BASE, 0, "done", shell=shell, slow=slow)


def other(
    title: str, command: tuple[str, ...], code: int, outcome: str, before: object, told: str = "", **more: object
) -> Case:
    return Case("Other processes", title, command, code, outcome, before, told=told, **more)


def stopped(name: str, code: int, told: str) -> Case:
    """Case of a signal to a search with two worker processes."""
    moment = Moment(after=1.0, by=signal.Signals[name])
    outcome = "one line; workers end, nothing is written"
    return Case("Signals", name, EXCITE, code, outcome, told=told, after=clean, moment=moment)


def make_unreadable(folder: Path) -> None:
    (folder / "secret.csv").write_text("t")
    (folder / "secret.csv").chmod(0)


def make_read_only(folder: Path) -> None:
    earlier_track(folder)
    folder.chmod(0o555)


def made_long_ago(folder: Path) -> None:
    for path in folder.rglob("*"):
        os.utime(path, (0, 0))


def leave_working_folder() -> None:
    os.mkdir("gone")
    os.chdir("gone")
    os.rmdir("../gone")


def nohup() -> None:
    signal.signal(signal.SIGHUP, signal.SIG_IGN)
    os.kill(os.getpid(), signal.SIGHUP)


_read_only, _still = unchanged("moved", make_read_only)
_page, _page_still = unchanged("page.html", earlier_page)
_filled, _filled_still = unchanged("moved", filled)

_ALL: list[Case] = [
    named("not UTF-8", f"{BYTES}.csv"),
    named("a line break", "line\nbreak.csv"),
    named("a tab, quotes, `$` and a backslash", "a\tb'\"$x\\.csv"),
    named("markup", "[bold]x[red].csv"),
    named("Greek letters and a face", "αβ😀.csv"),
    named("255 bytes", FILE),
    named("300 bytes", "n" * 296 + ".csv", 2, before=loop),
    Case("Names of inputs", "empty", ("doctor", "small.urdf", ""), 2, REFUSED),
    Case(
        "Names of inputs", "a dash first, after `--`", (*PREDICT, "--", "-log.csv"), 0, READ, copied_log("-log.csv")
    ),
    Case("Names of inputs", "a dash first, without `--`", (*PREDICT, "-log.csv"), 2, REFUSED, copied_log("-log.csv")),
    named("a loop of links", "loop.csv", 2, before=loop),
    named("a link to nothing", "link.csv", 2, before=link("link.csv", "missing.csv")),
    named("a link to the recording", "link.csv", before=link("link.csv", "new.csv")),
    named("a folder", "run.csv", 2, before=lambda folder: (folder / "run.csv").mkdir()),
    named("`/dev/null`", "/dev/null", 2, before=loop),
    named("a pipe that nobody writes", "pipe.csv", 2, before=lambda folder: os.mkfifo(folder / "pipe.csv")),
    named("a file without the right to read it", "secret.csv", 2, before=make_unreadable),
    outside("not UTF-8", BYTES),
    outside("a line break", "line\nbreak"),
    outside("a dash first", "-lab"),
    outside("255 bytes", "n" * LONGEST_NAME),
    outside("300 bytes", "n" * 300, 2),
    outside("a path of 5000 bytes", "/".join(["n" * 99] * 50), 2),
    outside("a folder below a file", "new.csv/lab", 2),
    outside("a file", "new.csv", 2),
    outside("a loop of links", "loop.csv", 2, before=loop),
    outside(
        "a link to a folder", "link", before=lambda folder: [(folder / "to").mkdir(), link("link", "to")(folder)]
    ),
    outside("the working folder", ".", after=exists("recording.csv", "new.csv", "run/estimate.json")),
    Case("Names of outputs", "the working folder, as a track", (*TRACK, "--out", "."), 2, REFUSED, after=clean),
    Case(
        "Names of outputs",
        "a folder with files of the user",
        (*TRACK, "--out", "moved"),
        2,
        KEPT,
        _filled,
        after=_filled_still,
    ),
    kept("files of more than 4 kB are refused (quota)", quota(4096), "File too large"),
    Case(
        "Disks",
        "the folder vanishes while it is written",
        (*TRACK, "--out", "sub/moved"),
        2,
        REFUSED,
        lambda folder: (folder / "sub").mkdir(),
        vanishing("open", "sub"),
        "could not be written",
        clean,
    ),
    Case(
        "Disks",
        "the page's folder is read-only",
        ("report", "run", "--out", "page.html"),
        2,
        KEPT,
        lambda folder: [_page(folder), folder.chmod(0o555)],
        without_rights,
        "could not be written",
        _page_still,
    ),
    Case(
        "Disks",
        "a read-only folder",
        (*TRACK, "--out", "moved"),
        2,
        KEPT,
        _read_only,
        without_rights,
        "is not writable",
        _still,
    ),
    Case(
        "Disks",
        "the folder on another file system",
        (*TRACK, "--out", "/dev/shm/armid-test/moved"),
        0,
        "written",
        after=lambda folder: shutil.rmtree("/dev/shm/armid-test"),
    ),
    under("no folder for temporary files", environment(TMPDIR="/nonexistent")),
    under("no `HOME`", environment(HOME=None)),
    under("a `HOME` that does not exist", environment(HOME="/nonexistent", ARMID_CACHE=None, XDG_CACHE_HOME=None)),
    under("a `HOME` that is a file", environment(HOME="/dev/null", ARMID_CACHE=None, XDG_CACHE_HOME=None)),
    under("a cache that is a file", environment(ARMID_CACHE="/dev/null")),
    under("no variables at all", os.environ.clear),
    under("`COLUMNS=0`", environment(COLUMNS="0")),
    under("`COLUMNS=1`", environment(COLUMNS="1")),
    under("`COLUMNS=wide`", environment(COLUMNS="wide")),
    under("an unknown terminal", environment(TERM="unknown", FORCE_COLOR="1")),
    under("an unknown time zone", environment(TZ="Nowhere/Never")),
    under("`OMP_NUM_THREADS=many`", environment(OMP_NUM_THREADS="many")),
    under("`ARMID_ALLOW=nonsense`", environment(ARMID_ALLOW="nonsense"), 2, REFUSED, "is not a limit"),
    under("a mask that takes all rights from others", lambda: os.umask(0o077)),
    under("a clock at 1970", old_clock),
    under("`SOURCE_DATE_EPOCH=0`", environment(SOURCE_DATE_EPOCH="0")),
    under("32 open files at most", limit(resource.RLIMIT_NOFILE, 32)),
    under("a working folder that was removed", leave_working_folder, 2, REFUSED),
    Case("Variables and limits", "files of 1970", (*PREDICT, "new.csv"), 0, READ, made_long_ago),
    fresh("`LANG=C`", "env", "-u", "LANG", "LC_ALL=C", "PYTHONUTF8=0", "PYTHONCOERCECLOCALE=0", slow=True),
    fresh(
        "`LANG=C`, and a name that is not UTF-8",
        "env",
        "LC_ALL=C",
        "PYTHONUTF8=0",
        "PYTHONCOERCECLOCALE=0",
        command=(*PREDICT, f"{BYTES}.csv"),
        outcome=READ,
        before=copied_log(f"{BYTES}.csv"),
    ),
    fresh("`PYTHONIOENCODING=ascii`", "env", "PYTHONIOENCODING=ascii", slow=True),
    fresh("Python with `-O`", "-O"),
    fresh(
        "Python with `-OO`, a result",
        "-OO",
        command=(*SIMULATE, "--out", "lab"),
        outcome=WRITTEN,
        after=exists("lab/truth.json"),
        slow=True,
    ),
    fresh(
        "1 GB of memory",
        command=("identify", "small.urdf", "log.csv", "--no-report", "--out", "again"),
        outcome=WRITTEN,
        inside=limit(resource.RLIMIT_AS, 1_000_000_000),
        after=exists("again/estimate.json"),
        shell=" ",
    ),
    closed("standard input closed", "<&-"),
    closed("standard output closed", ">&-"),
    closed("standard error closed", "2>&-"),
    closed("all streams closed", "<&- >&- 2>&-", slow=False),
    stream("output to a pipe without a reader", redirected(1, "pipe"), 141, "ends without a word"),
    stream("output to a full device", redirected(1, "/dev/full"), 2, REFUSED, told="No space left on device"),
    stream(
        "output as JSON to a full device", redirected(1, "/dev/full"), 2, REFUSED, (*BASE, "--json"), "No space left"
    ),
    stream(
        "messages to a full device", redirected(2, "/dev/full"), 2, "ends without a word", ("base", "missing.urdf")
    ),
    stream(
        "messages to a pipe without a reader",
        redirected(2, "pipe"),
        2,
        "ends without a word",
        ("base", "missing.urdf"),
    ),
    stream("no terminal, and colours asked for", environment(FORCE_COLOR="1"), 0, "done"),
    other(
        "a second writer of a folder",
        (*TRACK, "--out", "moved"),
        2,
        "one error, which names the process",
        locked_by_another,
        "moved is being written by armid track (process",
    ),
    other("a writer of another folder", (*TRACK, "--out", "elsewhere"), 0, WRITTEN, locked_by_another),
    other(
        "leftovers of a process that was killed",
        (*TRACK, "--out", "moved"),
        0,
        "written; they are removed",
        left_by_killed,
        after=exists("moved/track.csv"),
    ),
    other(
        "killed between two renames",
        ("track", "run", "new.csv", "--memory", "-1", "--out", "moved"),
        2,
        "the earlier result has its name again",
        between_renames,
        after=exists("moved/track.json"),
    ),
    other(
        "killed while files were moved into a folder with others",
        (*SIMULATE, "--out", "filled"),
        0,
        "written; other files are kept",
        lambda folder: [(folder / "filled").mkdir(), between_files(folder)],
        after=exists("filled/recording.csv", "filled/notes.txt"),
    ),
    stopped("SIGINT", 130, "interrupted; nothing was written"),
    stopped("SIGTERM", 143, "terminated; nothing was written"),
    stopped("SIGHUP", 129, "terminated, because the terminal was closed; nothing was written"),
    Case(
        "Signals",
        "SIGHUP, ignored by the caller (`nohup`)",
        (*SIMULATE, "--out", "lab"),
        0,
        WRITTEN,
        inside=nohup,
        after=exists("lab/truth.json"),
    ),
]

SLOW = {
    "markup",
    "Greek letters and a face",
    "a writer of another folder",
    "`LANG=C`, and a name that is not UTF-8",
    "`COLUMNS=1`",
    "an unknown terminal",
    "SIGHUP",
    "the folder on another file system",
}
"""Cases that run with the long tests only, because others are like them."""

CASES = [replace(case, slow=case.slow or case.name in SLOW) for case in _ALL]
