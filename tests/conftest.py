"""Options and settings of the whole suite."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path

import pytest
from hypothesis import settings

# No deadline, because a shared machine may stall; the same examples every time, so that a failure can be repeated.
settings.register_profile("armid", deadline=None, derandomize=True, database=None)
settings.load_profile("armid")


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--long", action="store_true", help="run the tests marked long, too")


OPTIONAL = {"witness": ("pinocchio", "pin"), "collision": ("coal", "coal")}
"""Module that tests with a marker need, and the package that contains it."""


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    reasons = {
        mark: f"the package {package} is not installed"
        for mark, (module, package) in OPTIONAL.items()
        if find_spec(module) is None
    }
    if not config.getoption("--long"):
        reasons["long"] = "takes more than half a minute; run with --long"
    for item in items:
        for mark, reason in reasons.items():
            if item.get_closest_marker(mark) is not None:
                item.add_marker(pytest.mark.skip(reason=reason))


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """Repeats what failed before the tests began (scripts/check), since a log is often read from its end."""
    failures = os.environ.get("ARMID_EARLIER_FAILURES")
    if failures and (text := Path(failures).read_text()):
        terminalreporter.write_sep("=", "failed before these tests")
        terminalreporter.write(text)


@pytest.fixture(scope="session", autouse=True)
def _own_cache() -> Iterator[None]:
    """A cache of the tests' own, never the user's, and screens that do not depend on the caller's terminal."""
    with tempfile.TemporaryDirectory() as folder, pytest.MonkeyPatch.context() as patch:
        patch.setenv("ARMID_CACHE", os.path.join(folder, "cache"))
        for name in ("COLUMNS", "LINES", "NO_COLOR", "FORCE_COLOR", "TTY_COMPATIBLE", "TTY_INTERACTIVE"):
            patch.delenv(name, raising=False)
        yield
