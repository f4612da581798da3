"""An error that nothing expected gives one line, a file with the trace, and an exit code of its own."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path

import pytest

from armid.atomic_file import replace_file
from armid.cli import last_handler
from armid.cli import main as cli
from armid.cli.last_handler import BROKEN_PIPE, UNEXPECTED, report_unexpected


@pytest.fixture
def failing(monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    """Runs the command line with a failure that nothing expects."""
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))

    def run(error: BaseException, *arguments: str) -> tuple[int, str, str]:
        def fail(*_: object, **__: object) -> None:
            raise error

        monkeypatch.setattr(cli, "app", fail)
        with pytest.raises(SystemExit) as ended:
            cli.main(list(arguments))
        return (int(ended.value.code or 0), *capsys.readouterr())

    return run


def test_an_unexpected_error_is_one_line_and_a_file(failing, tmp_path: Path):
    code, out, err = failing(ZeroDivisionError("by\nnothing"), "base", "x.urdf")
    assert code == UNEXPECTED and not out
    assert err.count("\n") == 1 and "ZeroDivisionError" in err and "by nothing" in err
    (trace,) = tmp_path.glob("armid-trace-*.txt")
    assert str(trace) in err
    text = trace.read_text()
    assert "armid base x.urdf" in text and "Traceback" in text and text.startswith("armid ")


def test_with_json_it_is_an_object(failing):
    code, out, _ = failing(ZeroDivisionError("x"), "base", "--json")
    assert code == json.loads(out)["exit_code"] == UNEXPECTED


def test_without_a_place_for_the_trace_there_is_still_one_line(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr("tempfile.tempdir", "/nowhere")
    assert "could not be written" in report_unexpected(ValueError("x"), [])


def test_a_broken_pipe_is_silent(failing):
    code, out, err = failing(BrokenPipeError())
    assert (code, out, err) == (BROKEN_PIPE, "", "")


@pytest.mark.parametrize("closed", ["<&-", ">&-", "2>&-", ">&- 2>&-", "| true", ">/dev/full"])
def test_closed_streams_give_no_trace(closed: str):
    done = subprocess.run(
        ["bash", "-c", f"{sys.executable} -m armid.cli base iiwa14-r820 {closed}"],
        capture_output=True,
        text=True,
        check=False,
    )
    assert "Traceback" not in done.stdout + done.stderr


@pytest.mark.parametrize(
    ("name", "code", "told"),
    [
        ("SIGTERM", 143, "terminated; nothing was written\n"),
        ("SIGHUP", 129, "terminated, because the terminal was closed; nothing was written\n"),
    ],
)
@pytest.mark.skipif(sys.platform == "win32", reason="no such signals")
def test_a_signal_ends_a_command_with_one_line(
    name: str, code: int, told: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    inherited = signal.signal(signal.Signals[name], signal.SIG_DFL)  # a shell may start the tests with it ignored
    try:
        monkeypatch.setattr(cli, "app", lambda *_, **__: signal.raise_signal(signal.Signals[name]))
        with pytest.raises(SystemExit) as ended:
            cli.main([])
        assert (ended.value.code, *capsys.readouterr()) == (code, "", told)
        assert signal.getsignal(signal.Signals[name]) == signal.SIG_DFL
    finally:
        signal.signal(signal.Signals[name], inherited)


@pytest.mark.skipif(sys.platform == "win32", reason="no such signals")
def test_a_signal_that_the_caller_ignores_is_ignored(monkeypatch: pytest.MonkeyPatch):
    def app(*_: object, **__: object) -> None:
        signal.raise_signal(signal.SIGHUP)

    monkeypatch.setattr(cli, "app", app)
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        with pytest.raises(SystemExit) as ended:
            cli.main([])
    finally:
        signal.signal(signal.SIGHUP, before)
    assert ended.value.code == 0


def test_the_message_names_what_was_written_before(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    def app(*_: object, **__: object) -> None:
        replace_file(tmp_path / "torque.csv", "t")
        raise KeyboardInterrupt

    monkeypatch.setattr(cli, "app", app)
    with pytest.raises(SystemExit) as ended:
        cli.main([])
    assert ended.value.code == 130
    assert capsys.readouterr().err == f"interrupted; {tmp_path / 'torque.csv'} was written before\n"


def test_an_interruption_of_the_parser_is_told(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]):
    """The parser turns it into an exit code of its own."""

    def stop() -> str:
        raise KeyboardInterrupt

    monkeypatch.setattr(cli, "next_step", stop)
    with pytest.raises(SystemExit) as ended:
        cli.main([])
    assert ended.value.code == 130
    assert capsys.readouterr().err.endswith("interrupted; nothing was written\n")


@pytest.mark.skipif(sys.platform == "win32", reason="no such signals")
def test_a_signal_whose_error_is_lost_is_raised_again(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    """Python ignores errors in functions that it calls when an object is removed."""

    def app(*_: object, **__: object) -> None:
        with suppress(SystemExit):
            signal.raise_signal(signal.SIGTERM)
        time.sleep(60.0)

    monkeypatch.setattr(last_handler, "AGAIN", 0.05)
    monkeypatch.setattr(cli, "app", app)
    with pytest.raises(SystemExit) as ended:
        cli.main([])
    assert ended.value.code == 143
    assert capsys.readouterr().err == "terminated; nothing was written\n"
    assert signal.getsignal(signal.SIGALRM) is signal.SIG_DFL
