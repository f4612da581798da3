"""Numbers and joint limits given as text by options of the command line."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from armid.checked_array import Array
from armid.errors import ArmidError

Limit = float | tuple[float, float]


def numbers(text: str | None, name: str, count: int) -> Array | None:
    """Numbers separated by commas or blanks, shape (count,); `None` if no text is given.

    Raises:
        ArmidError: The text is not a list of numbers, or the count of numbers is wrong.
    """
    if text is None:
        return None
    try:
        values = np.array([float(x) for x in text.replace(",", " ").split()])
    except ValueError:
        raise ArmidError(f"{name} {text} is not a list of numbers.", remedy="write for instance 0,0.5,-1.") from None
    if len(values) != count or not np.isfinite(values).all():
        raise ArmidError(
            f"{name} needs {count} finite numbers; found {len(values)}: {text}.",
            remedy="separate the numbers by commas or blanks.",
        )
    return values


def parse_limits(given: Sequence[str]) -> dict[tuple[str, str], Limit]:
    """Limits by joint and kind, from `JOINT.KIND=VALUE` or `JOINT.position=LOW:HIGH`, separated by commas.

    Raises:
        ArmidError: A text has neither of the two forms.
    """
    result: dict[tuple[str, str], Limit] = {}
    for text in (part.strip() for each in given for part in each.split(",")):
        name, equals, value = text.partition("=")
        joint, dot, kind = name.rpartition(".")
        low, colon, high = value.partition(":")
        try:
            if not equals or not dot:
                raise ValueError
            result[joint, kind] = (float(low), float(high)) if colon else float(value)
        except ValueError:
            raise ArmidError(
                f"--limit {text} is not a limit.",
                remedy="write JOINT.velocity=1.2 or JOINT.position=-1:1; kinds are position, velocity, acceleration, "
                "jerk, effort.",
            ) from None
    return result
