"""Locks of folders, groups of files and leftovers."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from armid.atomic_file import replace_file
from armid.errors import OutputError
from armid.output import file_group, journal, locks, renaming
from armid.output.file_group import replace_files
from armid.output.locks import claim, complete, end_claims, key_of, locked, start_claims
from armid.output.scratch import remove_abandoned, scratch_folder
from armid.study.storage.atomic_folder import whole_folder

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="open files cannot be removed")

HOLDER = """
import sys, time
from pathlib import Path
from armid.output import locks
locks.start_claims("armid identify")
with locks.locked(Path(sys.argv[1])):
    print("locked", flush=True)
    time.sleep(60)
"""


@pytest.fixture
def holder(tmp_path: Path) -> Iterator[subprocess.Popen[str]]:
    """Another process that writes the folder `run`."""
    target = str(tmp_path.resolve() / "run")
    with subprocess.Popen([sys.executable, "-c", HOLDER, target], stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None and process.stdout.readline() == "locked\n"
        yield process
        process.kill()


def write_run(folder: Path, text: str) -> None:
    with whole_folder(folder, "run.json", "run") as draft:
        (draft / "run.json").write_text(text)


def names(folder: Path) -> set[str]:
    return {str(path.relative_to(folder)) for path in folder.rglob("*")}


def contents(folder: Path) -> dict[str, str]:
    return {name: (folder / name).read_text() for name in names(folder) if (folder / name).is_file()}


def test_a_second_writer_is_told_who_writes(tmp_path: Path, holder: subprocess.Popen[str]):
    with pytest.raises(OutputError, match=rf"run is being written by armid identify \(process {holder.pid} on"):
        write_run(tmp_path / "run", "second")
    start_claims("armid track")
    try:
        with pytest.raises(OutputError, match="is being written"):
            claim(tmp_path / "run")
        claim(tmp_path / "other")
    finally:
        end_claims()
    assert names(tmp_path) == {f".armid-{key_of('run')}.lock"}


def test_a_killed_writer_leaves_its_lock_to_the_next(tmp_path: Path, holder: subprocess.Popen[str]):
    holder.kill()
    holder.wait()
    assert names(tmp_path) == {f".armid-{key_of('run')}.lock"}
    write_run(tmp_path / "run", "second")
    assert contents(tmp_path) == {"run/run.json": "second"}


def test_one_process_may_lock_again(tmp_path: Path):
    with locked(tmp_path / "run") as first, locked(tmp_path / "run") as second:
        assert first is second
    assert names(tmp_path) == set()


def test_threads_write_one_after_the_other(tmp_path: Path):
    """A group of files waits for the other thread; a folder, whose computation may be long, does not."""
    told: list[str] = []

    def write() -> None:
        with pytest.raises(OutputError, match="is being written by a Python program"):
            write_run(tmp_path / "run", "second")
        told.append("refused")
        replace_files(tmp_path / "run", {"run.json": "third"})
        told.append("written")

    with whole_folder(tmp_path / "run", "run.json", "run") as draft:
        (draft / "run.json").write_text("first")
        thread = threading.Thread(target=write)
        thread.start()
        while not told:
            time.sleep(0.01)
    thread.join()
    assert told == ["refused", "written"] and contents(tmp_path) == {"run/run.json": "third"}


def test_a_fork_leaves_locks_to_its_parent(tmp_path: Path):
    with locked(tmp_path / "run"):
        child = os.fork()
        if not child:
            os._exit(len(locks._held))
        assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 0
        assert len(names(tmp_path)) == 1


@pytest.mark.parametrize("exchange", [True, False])
def test_a_folder_is_replaced_at_once(tmp_path: Path, exchange: bool, monkeypatch: pytest.MonkeyPatch):
    if not exchange:
        monkeypatch.setattr(renaming, "_exchange", lambda *_: False)
    for text in ("first", "second"):
        write_run(tmp_path / "run", text)
        assert contents(tmp_path) == {"run/run.json": text}


def test_a_folder_that_was_set_aside_gets_its_name_back(tmp_path: Path):
    """After a kill between the two renames of a system that cannot exchange names."""
    write_run(tmp_path / "run", "earlier")
    (tmp_path / "run").rename(tmp_path / f".armid-{key_of('run')}.old")
    (tmp_path / f".armid-{key_of('run')}.draft").mkdir()
    with locked(tmp_path / "run"):
        assert (tmp_path / "run" / "run.json").read_text() == "earlier"
    assert contents(tmp_path) == {"run/run.json": "earlier"} and len(names(tmp_path)) == 2


def test_the_only_copy_of_a_result_is_never_removed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """On a system that cannot exchange names, if neither the new nor the earlier folder can be renamed."""
    write_run(tmp_path / "run", "earlier")
    rename = Path.rename

    def refuses(self: Path, target: Path) -> Path:
        if target.name == "run":
            raise OSError(5, "Input/output error")
        return rename(self, target)

    monkeypatch.setattr(renaming, "_exchange", lambda *_: False)
    with monkeypatch.context() as patch:
        patch.setattr(Path, "rename", refuses)
        with pytest.raises(OutputError, match="Input/output error"):
            write_run(tmp_path / "run", "new")
    assert [*contents(tmp_path).values()] == ["earlier"]


def test_a_sweep_removes_leftovers_and_nothing_else(tmp_path: Path, holder: subprocess.Popen[str]):
    kept = {f".armid-{key_of('run')}.lock", "notes.txt", ".armid-notes", ".hidden.part"}
    for name in kept - {f".armid-{key_of('run')}.lock"}:
        (tmp_path / name).write_text("of the user")
    (tmp_path / ".armid-x.part").write_text("half")
    (tmp_path / ".armid-y.probe").mkdir()
    (tmp_path / f".armid-{key_of('gone')}.draft").mkdir()
    (tmp_path / f".armid-{key_of('dead')}.lock").write_text(json.dumps({"target": b"dead".hex()}))
    (tmp_path / f".armid-{key_of('dead')}.draft").mkdir()
    locks.start_claims("armid")
    locks.end_claims()
    replace_file(tmp_path / "new.txt", "new")
    assert names(tmp_path) == {*kept, "new.txt"}


def test_a_folder_with_files_of_the_user_keeps_them(tmp_path: Path):
    folder = tmp_path / "lab"
    replace_files(folder, {"a.txt": "1", "b/c.txt": b"1"})
    (folder / "notes.txt").write_text("of the user")
    replace_files(folder, {"a.txt": "2", "d.txt": "2"}, stale=["b/c.txt", "missing.txt"])
    assert contents(tmp_path) == {"lab/a.txt": "2", "lab/d.txt": "2", "lab/notes.txt": "of the user"}


@pytest.mark.parametrize("among", [True, False])
@pytest.mark.parametrize("failing", ["draft", "commit"])
def test_a_failure_leaves_all_files_as_they_were(
    tmp_path: Path, among: bool, failing: str, monkeypatch: pytest.MonkeyPatch
):
    folder = tmp_path / "lab"
    replace_files(folder, {"a.txt": "1", "b.txt": "1"})
    if among:
        (folder / "notes.txt").write_text("of the user")
    before = contents(tmp_path)

    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    if failing == "draft":
        monkeypatch.setattr(journal, "write_new", full)
        monkeypatch.setattr(file_group, "write_new", full)
    else:
        replace = os.replace
        monkeypatch.setattr(
            os, "replace", lambda a, b: full() if str(b).endswith("lab/b.txt") and "new" in str(a) else replace(a, b)
        )
        monkeypatch.setattr(renaming, "_exchange", full)
    with pytest.raises(OutputError, match="No space left on device"):
        replace_files(folder, {"a.txt": "2", "b.txt": "2", "c.txt": "2"})
    assert contents(tmp_path) == before


def test_files_that_were_complete_are_put_in_place_before_they_are_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    folder = tmp_path / "lab"
    replace_files(folder, {"a.txt": "1", "b.txt": "1"})
    (folder / "notes.txt").write_text("of the user")

    def killed(_: Path) -> None:
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(journal, "finish", killed)
        with pytest.raises(KeyboardInterrupt):
            replace_files(folder, {"a.txt": "2", "b.txt": "2"}, stale=["c.txt"])
    assert (folder / "a.txt").read_text() == "1" and (folder / journal.COMMIT).is_dir()
    complete(folder)
    assert contents(folder) == {"a.txt": "2", "b.txt": "2", "notes.txt": "of the user"}


def test_a_scratch_folder_lives_as_long_as_its_process(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    (tmp_path / "armid-scratch-of-a-killed-process").mkdir()
    with scratch_folder() as folder:
        remove_abandoned()
        assert names(tmp_path) == {folder.name}
    assert names(tmp_path) == set()


WORKERS = """
import os, sys, time
from armid.excitation.design.multistart import single_threaded_pool
with single_threaded_pool(2) as pool:
    print(*{pool.submit(os.getpid).result() for _ in range(20)}, *pool._processes, flush=True)
    time.sleep(60)
"""


def lives(process: int) -> bool:
    try:
        return Path(f"/proc/{process}/stat").read_text().rsplit(")", 1)[1].split()[0] not in "ZX"
    except OSError:
        return False


@pytest.mark.skipif(sys.platform != "linux", reason="processes are found in /proc")
def test_workers_end_with_a_parent_that_is_killed():
    with subprocess.Popen([sys.executable, "-c", WORKERS], stdout=subprocess.PIPE, text=True) as parent:
        assert parent.stdout is not None
        workers = {int(word) for word in parent.stdout.readline().split()}
        assert len(workers) == 2 and all(map(lives, workers))
        os.kill(parent.pid, signal.SIGKILL)
        parent.wait()
        end = time.monotonic() + 2.0  # what the tests of killed commands allow, too
        while any(map(lives, workers)) and time.monotonic() < end:
            time.sleep(0.01)
        assert not any(map(lives, workers))
