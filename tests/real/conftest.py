"""Real recordings and descriptions live outside the repository."""

from __future__ import annotations

from pathlib import Path

import pytest

DATA = Path(__file__).resolve().parents[3] / "shared" / "data"


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """The folder of real recordings; the test is skipped where it is missing."""
    if not DATA.is_dir():
        pytest.skip(f"the folder of real recordings, {DATA}, is missing")
    return DATA
