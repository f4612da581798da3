"""One damaged input of each kind through a command that reads it."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

SCRIPT = Path(__file__).parents[2] / "scripts" / "fuzz"


@pytest.mark.skipif(sys.platform == "win32", reason="attempts are forked")
def test_a_damaged_input_is_read_or_refused(tmp_path: Path):
    """In a program of its own, because an attempt is a copy of the process with limits."""
    command = [sys.executable, str(SCRIPT), "--mutants", "1", "--json", "--keep", str(tmp_path)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    told = json.loads(done.stdout)
    assert told["failures"] == [] and told["runs"] >= 20
