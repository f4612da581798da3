"""Option `--validate`, which takes several values, as the parser gets it."""

from __future__ import annotations

import pytest

from armid.cli.main import _repeat_option


@pytest.mark.parametrize(
    ("given", "parsed"),
    [
        (["s.toml", "--validate", "a", "b"], ["s.toml", "--validate", "a", "--validate", "b"]),
        (["--validate", "a", "--rate", "5"], ["--validate", "a", "--rate", "5"]),
        # Without a value, the option stays alone, so that the parser refuses it instead of losing it.
        (["s.toml", "--validate"], ["s.toml", "--validate"]),
        (["s.toml", "--validate", "--rate", "5"], ["s.toml", "--validate", "--rate", "5"]),
        (["--validate", "a", "--validate"], ["--validate", "a", "--validate"]),
        (["--validate", "--validate", "a"], ["--validate", "--validate", "a"]),
    ],
)
def test_every_value_has_the_option_before_it(given: list[str], parsed: list[str]):
    assert _repeat_option("--validate", given) == parsed
