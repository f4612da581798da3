"""Read-only float64 arrays whose shape and finiteness are checked."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from armid.errors import ArmidError

Array = NDArray[np.float64]


def array(value: ArrayLike, shape: tuple[int | None, ...], name: str, *, finite: bool = True) -> Array:
    """Read-only float64 copy of `value`, with its shape and finiteness checked.

    Args:
        value: Numbers in any form that NumPy can convert.
        shape: Expected length of each axis; `None` accepts any length.
        name: Name of the array in messages.
        finite: True if NaN and infinity are refused.

    Raises:
        ArmidError: The value is not numeric, has another shape, or is not finite.
    """
    try:
        result = np.array(value, dtype=np.float64, order="C", copy=True)
    except (TypeError, ValueError) as error:
        raise ArmidError(f"{name} must be an array of numbers; found {value!r:.80}.") from error
    if result.ndim != len(shape) or any(
        want is not None and want != have for want, have in zip(shape, result.shape, strict=True)
    ):
        wanted = "(" + ", ".join("any" if n is None else str(n) for n in shape) + ")"
        raise ArmidError(f"{name} must have shape {wanted}; found {result.shape}.")
    if finite and not np.isfinite(result).all():
        first = tuple(int(i) for i in np.argwhere(~np.isfinite(result))[0])
        raise ArmidError(f"{name} must be finite; found {result[first]} at index {first}.")
    result.setflags(write=False)
    return result
