"""The kernel compiles for Windows: every source and instruction set of CMakeLists.txt, with MinGW-w64.

Nothing is run. GCC aligns the stack of 64-bit Windows to 16 bytes, so wheels are built with Clang there.
"""

from __future__ import annotations

import re
import shutil
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
COMPILER = "x86_64-w64-mingw32-g++"
BUILD = (ROOT / "CMakeLists.txt").read_text()
ISAS = {
    name: (lanes, options.split()) for name, lanes, options in re.findall(r"add_kernel\((\w+) (\d) ?(.*)\)", BUILD)
}
FLAGS = ("-std=c++20", "-O3", "-fno-math-errno", "-fno-trapping-math", "-ffp-contract=fast", "-Wall", "-Wextra")

pytestmark = [
    pytest.mark.cross,
    pytest.mark.skipif(shutil.which(COMPILER) is None, reason=f"{COMPILER} (MinGW-w64) is not installed"),
]


def compiled(source: str, *options: str, folder: Path) -> Path:
    made = folder / "made.o"
    command = [
        COMPILER,
        *FLAGS,
        "-Werror",
        "-Wno-psabi",
        *options,
        "-c",
        str(ROOT / "native" / source),
        "-o",
        str(made),
    ]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert not done.returncode, done.stderr
    return made


def test_the_instruction_sets_are_found():
    assert set(ISAS) == {"baseline", "avx2", "avx512"} and {lanes for lanes, _ in ISAS.values()} == {"2", "4", "8"}
    assert all(flag in BUILD for flag in FLAGS[1:])


@pytest.mark.parametrize(
    "isa", ["baseline", *(pytest.param(isa, marks=pytest.mark.long) for isa in ("avx2", "avx512"))]
)
def test_the_kernel_compiles_for_windows(isa: str, tmp_path: Path):
    lanes, options = ISAS[isa]
    made = compiled("kernel.cpp", f"-DARMID_ISA={isa}", f"-DARMID_LANES={lanes}", *options, folder=tmp_path)
    assert made.read_bytes()[:2] == b"\x64\x86"  # the machine of a COFF object: x86-64


def test_the_tape_compiles_for_windows(tmp_path: Path):
    assert compiled("tape.cpp", folder=tmp_path).stat().st_size > 1000
