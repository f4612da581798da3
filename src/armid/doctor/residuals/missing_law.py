"""Type `MissingLaw`: a law of the torque of one joint that the doctor's model lacks."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from armid.checked_array import Array

FRICTION = "friction-missing"
"""Code of the findings on laws of the velocity, or of the path since a reversal."""

ANGLE = "residual-by-angle"
"""Code of the findings on laws of the position."""


@dataclass(frozen=True, slots=True, eq=False)
class MissingLaw:
    """Law that the model lacks, for one joint.

    Attributes:
        joint: Index of the joint.
        code: Code of the finding.
        text: Quantity on which the torque depends, in words.
        columns: Columns of the law, shape (k, M).
        term: Name of the term that has this law; empty if there is none.
        options: Options of the term.
        cause: Cause that has to be found by hand, if no term has the law and it is no spring.
    """

    joint: int
    code: str
    text: str
    columns: Array
    term: str
    options: Mapping[str, Any]
    cause: str = ""
