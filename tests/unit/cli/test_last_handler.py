"""An error that nothing expected gives one line, a file with the trace, and an exit code of its own."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

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
