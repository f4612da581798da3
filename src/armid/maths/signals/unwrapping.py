"""Removal of the jumps by whole turns from recorded angles."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from armid.checked_array import Array
from armid.maths.median import median


def whole_turn_jumps(x: Array, turn: float, tolerance: float) -> tuple[NDArray[np.bool_], Array]:
    """Steps from sample to sample that are whole turns, and the number of turns of each step.

    If the usual step is as large as the tolerance, wraps cannot be told from motion, and no step counts as one.

    Args:
        x: Angles, shape (N,).
        turn: Full turn, in the unit of the angles.
        tolerance: Largest difference between a jump and a whole number of turns, in the unit of the angles.

    Returns:
        Mask of the jumps, and number of turns in each step, shape (N - 1,) each.
    """
    step = np.diff(x)
    whole = np.round(step / turn)
    jump = whole != 0.0
    if jump.any():
        jump &= np.abs(step - turn * whole) < tolerance
        if jump.any() and median(np.abs(step)) >= tolerance:
            jump[:] = False
    return jump, whole


def without_turns(x: Array, jump: NDArray[np.bool_], whole: Array, turn: float) -> Array:
    """Angles (N,) from which the jumps found by `whole_turn_jumps` are subtracted."""
    return np.concatenate([x[:1], x[1:] - turn * np.cumsum(np.where(jump, whole, 0.0))])
