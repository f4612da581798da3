"""Checks of shapes (options of torque terms) that several terms use."""

from __future__ import annotations

from itertools import pairwise

from armid.errors import ModelError


def require_width(what: str, width: float) -> None:
    """Raises an error unless a width is a finite number that is not negative.

    Raises:
        ModelError: The width is negative, infinite or not a number.
    """
    if not _is_number(width) or not 0.0 <= width < float("inf"):
        raise ModelError(f"{what} must be finite and not negative; found {width!r}.")


def require_positive(what: str, value: float, least: float = 0.0) -> None:
    """Raises an error unless a value is finite, positive and not less than `least`.

    Raises:
        ModelError: The value is out of range or not a number.
    """
    if not _is_number(value) or not (value > 0.0 and least <= value < float("inf")):
        bound = f"at least {least:g}" if least > 0.0 else "positive"
        raise ModelError(f"{what} must be {bound}; found {value!r}.")


def require_rising(what: str, values: object) -> tuple[float, ...]:
    """Returns the values as a tuple; raises an error unless they are positive numbers in ascending order.

    Raises:
        ModelError: There are no values, or they are not positive, or not ascending.
    """
    if isinstance(values, tuple | list):
        numbers: tuple[float, ...] = tuple(values)
        positive = all(_is_number(x) and 0.0 < x < float("inf") for x in numbers)
        if numbers and positive and all(a < b for a, b in pairwise(numbers)):
            return numbers
    raise ModelError(f"{what} must be positive numbers in ascending order; found {values!r}.")


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)
