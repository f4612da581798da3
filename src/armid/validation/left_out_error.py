"""Torque error on training data that were left out of the estimate, and the error expected on another recording."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from armid.checked_array import Array, array
from armid.estimation.crossvalidation import held_out_squares, rms_by_joint
from armid.estimation.problem import StandardParameters
from armid.estimation.uncertainty.prediction_error import ExpectedError, PredictionError, expected_error
from armid.information.information import Information, total

FOUND_AGAIN = 1.5
"""Lower limit of the ratio of the upper end of the expected error to the RMS error on left-out data. On the KUKA LBR
Med 7, whose training recording excites the arm weakly, errors on the other recording were 0.4 to 1.6 times those on
left-out parts. Without this limit, they were 0.6 to 4 times the upper end."""


@dataclass(frozen=True, eq=False, slots=True)
class LeftOutError:
    """Torque error of each joint on left-out training data, shape (n,); NaN for a joint without such rows.

    Attributes:
        kind: `recordings` if whole recordings were left out in turn, or `parts` for parts of the only recording.
        rms: RMS torque error of estimates without these data, on the left-out data [N·m or N].
        description: RMS torque error on the same rows with the inertial parameters of the description, without
            friction [N·m or N]; `None` if the description does not give every link a mass.
        expected: RMS error that is expected on another recording, with its 90 % interval.
    """

    kind: str
    rms: Array
    description: Array | None
    expected: ExpectedError

    def __post_init__(self) -> None:
        for name in ("rms", "description"):
            value = getattr(self, name)
            if value is not None:
                object.__setattr__(self, name, array(value, (None,), name, finite=False))


def left_out_error(
    kind: str,
    squares: Array,
    rows: NDArray[np.int64],
    error: PredictionError,
    noise: Array,
    standard: StandardParameters,
    left_out: Information,
) -> LeftOutError:
    """Computes the torque error on left-out training data from sums of squared errors.

    Args:
        kind: `recordings` or `parts`.
        squares: Sum of squared errors of each joint on the left-out data, shape (n,) [(N·m)² or N²].
        rows: Number of rows of each joint in the left-out data, shape (n,).
        error: Facts about the training recordings.
        noise: Standard deviation of the torque of each joint about the model, shape (n,) [N·m or N].
        standard: Standard parameters, with those of the description.
        left_out: Factors of the left-out data, in base parameters that are common to all recordings.
    """
    description = None
    if standard.nominal is not None and standard.described:
        nominal = standard.regrouping @ standard.nominal
        description = rms_by_joint(held_out_squares(total(left_out), nominal), rows)
    rms, expected = rms_by_joint(squares, rows), expected_error(error, noise)
    high = np.fmax(expected.high, FOUND_AGAIN * rms)
    return LeftOutError(kind, rms, description, ExpectedError(expected.rms, expected.low, high))
