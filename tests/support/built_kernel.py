"""Plugin of pytest that takes the compiled kernel from the folder `ARMID_BUILT` (scripts/sanitize)."""

from __future__ import annotations

import os
import sys
from importlib.machinery import ExtensionFileLoader
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path

NAME = "armid.kernel._native"


def _load(folder: Path) -> None:
    """Loads the module before armid is imported, so that its import finds it."""
    path = next(folder.glob("_native*.so"))
    spec = spec_from_file_location(NAME, path, loader=ExtensionFileLoader(NAME, str(path)))
    assert spec is not None and spec.loader is not None and NAME not in sys.modules
    module = module_from_spec(spec)
    spec.loader.exec_module(module)
    sys.modules[NAME] = module


_load(Path(os.environ["ARMID_BUILT"]))
