"""BLAS threads: one within armid's stages and in the command line, the caller's own number elsewhere."""

from __future__ import annotations

import json
import os
import platform
import subprocess
import sys

import numpy as np
import pytest
from threadpoolctl import ThreadpoolController

from armid.threads import ONE_THREAD, one_blas_thread

np.linalg.inv(np.eye(2))  # BLAS is loaded


def counts() -> set[int]:
    """Threads of NumPy's and SciPy's BLAS; further packages of one process may have one that was built without."""
    found = [each for each in ThreadpoolController().info() if each["user_api"] == "blas"]
    return {each["num_threads"] for each in found if "numpy" in each["filepath"] or "scipy" in each["filepath"]}


@pytest.fixture
def two_threads():
    if not counts():
        pytest.skip("threadpoolctl does not know this BLAS")
    with ThreadpoolController().limit(limits=2, user_api="blas"):
        yield


def test_a_stage_has_one_thread_and_its_caller_keeps_his(two_threads: None):
    @one_blas_thread
    def inner() -> set[int]:
        return counts()

    @one_blas_thread
    def outer() -> tuple[set[int], set[int]]:
        return inner(), counts()

    assert outer() == ({1}, {1}) and counts() == {2}


def test_a_stage_that_fails_restores_the_number(two_threads: None):
    @one_blas_thread
    def fails() -> None:
        raise ValueError

    with pytest.raises(ValueError):
        fails()
    assert counts() == {2}


SCRIPT = """
import json
from armid.cli.main import main
try:
    main(["base", "ur5e", "--json"])
except SystemExit:
    pass
from threadpoolctl import ThreadpoolController
print(json.dumps([each["num_threads"] for each in ThreadpoolController().info() if each["user_api"] == "blas"]))
"""


@pytest.mark.parametrize(("own", "expected"), [({}, 1), ({"OPENBLAS_NUM_THREADS": "2"}, 2)])
def test_the_command_line_has_one_thread_unless_the_user_says_otherwise(own: dict[str, str], expected: int):
    if expected > (os.cpu_count() or 1):
        pytest.skip("more threads than cores")
    environment = {name: value for name, value in os.environ.items() if name not in ONE_THREAD} | own
    done = subprocess.run([sys.executable, "-c", SCRIPT], env=environment, capture_output=True, text=True, check=True)
    assert set(json.loads(done.stdout.splitlines()[-1])) <= {expected}


def test_where_the_process_is_limited_no_library_is_looked_for():
    script = (
        "import sys\nfrom armid.threads import one_blas_thread, prefer_one_thread\nprefer_one_thread()\n"
        "import numpy\none_blas_thread(lambda: numpy.eye(2) @ numpy.eye(2))()\nprint('threadpoolctl' in sys.modules)"
    )
    environment = {name: value for name, value in os.environ.items() if name not in ONE_THREAD}
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True, env=environment)
    assert done.stdout.strip() == "False"


@pytest.mark.skipif(not platform.libc_ver()[0].startswith("glibc"), reason="a setting of the GNU C library")
def test_memory_of_large_arrays_is_used_again():
    script = (
        "import resource, sys\n"
        "from armid.threads import keep_freed_memory\n"
        "if sys.argv[1] == 'kept':\n    keep_freed_memory()\n"
        "before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt\n"
        "for _ in range(10):\n    blocks = [b'1' * 20_000_000 for _ in range(4)]\n    del blocks\n"
        "print(resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before)\n"
    )

    def faults(how: str) -> int:
        done = subprocess.run([sys.executable, "-c", script, how], capture_output=True, text=True, check=True)
        return int(done.stdout)

    assert faults("kept") < 0.5 * faults("returned")
