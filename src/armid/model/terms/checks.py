"""Checks of shapes that several terms share."""

from __future__ import annotations

from itertools import pairwise

from armid.errors import ModelError

__all__ = ["require_positive", "require_rising", "require_width"]


def require_width(what: str, width: float) -> None:
    """Refuse a negative width, and what is no number.

    Raises:
        ModelError: It is.
    """
    if not _is_number(width) or not 0.0 <= width < float("inf"):
        raise ModelError(f"{what} must be zero or positive; found {width!r}.")


def require_positive(what: str, value: float, least: float = 0.0) -> None:
    """Refuse what is not above zero, or below `least` where one is given.

    Raises:
        ModelError: It is.
    """
    if not _is_number(value) or not (value > 0.0 and least <= value < float("inf")):
        bound = f"at least {least:g}" if least > 0.0 else "positive"
        raise ModelError(f"{what} must be {bound}; found {value!r}.")


def require_rising(what: str, values: object) -> tuple[float, ...]:
    """Positive numbers, each above the one before, at least one of them.

    Raises:
        ModelError: They are not.
    """
    if isinstance(values, tuple | list):
        numbers: tuple[float, ...] = tuple(values)
        positive = all(_is_number(x) and 0.0 < x < float("inf") for x in numbers)
        if numbers and positive and all(a < b for a, b in pairwise(numbers)):
            return numbers
    raise ModelError(f"{what} must be positive numbers in rising order; found {values!r}.")


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)
