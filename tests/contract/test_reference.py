"""The pages of docs/reference say what the code says, in plain Markdown."""

from __future__ import annotations

import importlib.util
from pathlib import Path
from types import ModuleType

import pytest

DOCS = Path(__file__).resolve().parents[2] / "docs"


@pytest.fixture(scope="module")
def reference() -> ModuleType:
    spec = importlib.util.spec_from_file_location("reference", DOCS / "extensions" / "reference.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_the_pages_are_those_of_the_code(reference: ModuleType):
    for path, text in reference.pages().items():
        assert path.read_text(encoding="utf-8") == text, f"stale: {path.name}; uv run --all-extras scripts/reference"


def test_commands_and_keys_can_be_read_without_building_the_site():
    commands, keys = ((DOCS / "reference" / name).read_text(encoding="utf-8") for name in ("cli.md", "keys.md"))
    assert "## `armid identify`" in commands and "| `--validate`" in commands
    assert "## `[[recording]]`" in keys and "| `drive_gain` |" in keys
    assert "```{" not in commands and "```{" not in keys  # directives are empty boxes anywhere else
