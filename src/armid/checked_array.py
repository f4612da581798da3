"""Read-only float64 arrays whose shape and finiteness are checked."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from armid.errors import ArmidError

Array = NDArray[np.float64]


def array(value: ArrayLike, shape: tuple[int | None, ...], name: str, *, finite: bool = True) -> Array:
    """Read-only float64 array with the content of `value`, with its shape and finiteness checked.

    An array that is read-only, contiguous and of float64, such as a part of a checked array, is not copied.

    Args:
        value: Numbers in any form that NumPy can convert.
        shape: Expected length of each axis; `None` accepts any length.
        name: Name of the array in messages.
        finite: True if NaN and infinity are refused.

    Raises:
        ArmidError: The value is not numeric, has another shape, or is not finite.
    """
    try:
        kept = isinstance(value, np.ndarray) and is_read_only(value)
        result = np.array(value, dtype=np.float64, order="C", copy=None if kept else True)
    except (TypeError, ValueError) as error:
        raise ArmidError(f"{name} must be an array of numbers; found {value!r:.80}.") from error
    if result.ndim != len(shape) or any(
        want is not None and want != have for want, have in zip(shape, result.shape, strict=True)
    ):
        wanted = "(" + ", ".join("any" if n is None else str(n) for n in shape) + ")"
        raise ArmidError(f"{name} must have shape {wanted}; found {result.shape}.")
    if finite and not all_finite(result):
        first = tuple(int(i) for i in np.argwhere(~np.isfinite(result))[0])
        raise ArmidError(f"{name} must be finite; found {result[first]} at index {first}.")
    result.setflags(write=False)
    return result


def is_read_only(x: NDArray[Any]) -> bool:
    """Checks whether neither an array nor the array that it is a view of can be written to."""
    owner: object = x
    while isinstance(owner, np.ndarray):
        if owner.flags.writeable:
            return False
        owner = owner.base
    return owner is None  # the memory of another owner may change


def frozen(x: NDArray[Any]) -> NDArray[Any]:
    """Makes an array read-only that its maker does not use further, so that `array` need not copy it; returns it."""
    x.setflags(write=False)
    return x


def all_finite(x: Array) -> bool:
    """Checks whether all values of a contiguous array are finite, without an array of flags where they are."""
    with np.errstate(over="ignore", invalid="ignore"):
        total = np.add.reduce(x, axis=None)  # of values that are not finite, no sum is finite
    return bool(np.isfinite(total)) or bool(np.isfinite(x).all())
