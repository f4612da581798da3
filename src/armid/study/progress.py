"""Callbacks that report the progress of an identification."""

from __future__ import annotations

from collections.abc import Callable

Progress = Callable[[str, float], None]
"""Callback with the name of the stage and its finished share."""


def no_progress(stage: str, share: float) -> None:
    """Callback that ignores progress."""
    del stage, share
