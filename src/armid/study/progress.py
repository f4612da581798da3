"""Callbacks that report the progress of an identification."""

from __future__ import annotations

from collections.abc import Callable

Progress = Callable[[str, float], None]
"""Callback with the name of a stage of the identification and the share of the stage that is done, from 0 to 1."""


def no_progress(stage: str, share: float) -> None:
    """Callback that ignores progress."""
    del stage, share
