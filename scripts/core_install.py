"""Size of the core of armid in an environment of its own, without extras, and an identification with it.

`python scripts/core_install.py [FOLDER]` makes a virtual environment in a temporary folder, or in FOLDER, which is
then kept, installs armid without extras, says the sizes of all installed packages and their sum, reads a URDF and an
MJCF, and identifies the virtual arm of `armid demo`. It fails where the sum is above the limit, or where a package of
an extra is installed.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from pathlib import Path

LIMIT = 200.0
"""Largest size of all installed packages [MB]."""

TOOLS = ("pip", "setuptools", "pkg_resources", "wheel", "_distutils_hack", "distutils-precedence.pth")
"""Packages of an environment into which nothing was installed yet."""

ABSENT = ("pinocchio", "coal", "mujoco", "plotly")
"""Modules that only extras install."""


def main() -> int:
    """Install, measure and identify."""
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(sys.argv[1] if len(sys.argv) > 1 else temporary).resolve()
        source = Path(__file__).parents[1]
        subprocess.run([sys.executable, "-m", "venv", folder / "env"], check=True)
        binaries = folder / "env" / ("Scripts" if os.name == "nt" else "bin")
        python = str(binaries / "python")
        subprocess.run([python, "-m", "pip", "install", "--quiet", source], check=True)
        find = "import sysconfig; print(sysconfig.get_paths()['platlib'])"
        found = subprocess.run([python, "-c", find], check=True, capture_output=True, text=True)
        packages = Path(found.stdout.strip())
        sizes = {path.name: _size(path) for path in packages.iterdir() if not path.name.startswith(TOOLS)}
        for name, size in sorted(sizes.items(), key=lambda item: -item[1])[:12]:
            sys.stdout.write(f"{size:8.1f} MB  {name}\n")
        total = sum(sizes.values())
        sys.stdout.write(f"{total:8.1f} MB  all installed packages, at most {LIMIT:g} MB\n")
        sys.stdout.flush()
        there = [name for name in ABSENT if (packages / name).exists()]
        arms = source / "tests" / "contract" / "arms"
        for command in (["base", arms / "arm.urdf"], ["base", arms / "arm.mjcf"], ["demo"]):
            subprocess.run([str(binaries / "armid"), *command], check=True, cwd=folder)
    if there:
        sys.stdout.write(f"installed, although no extra was asked for: {', '.join(there)}\n")
    return 1 if there or total > LIMIT else 0


def _size(path: Path) -> float:
    """Size of a file, or of all files in a folder without compiled bytecode, which depends on what was run [MB]."""
    files = [path] if path.is_file() else [each for each in path.rglob("*") if each.is_file()]
    return sum(each.stat().st_size for each in files if each.suffix != ".pyc") / 1e6


if __name__ == "__main__":
    sys.exit(main())
