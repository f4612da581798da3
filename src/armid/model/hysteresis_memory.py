"""Operators that compute the hysteresis states of torque laws, which depend on the earlier motion.

The state of a node is updated from sample to sample along a contiguous run. Its initial value is unknown. Therefore a
state is used only from the first sample at which all possible initial values lead to the same state.
"""

from __future__ import annotations

from dataclasses import dataclass

from armid.errors import ModelError
from armid.model.torque_law_expression import Expression, maximum, minimum, symbol

Coordinate = tuple[tuple[int, float], ...]
"""Coordinate c = Σ w_j q_j, as pairs of joint index j and weight w_j."""


@dataclass(frozen=True, slots=True)
class Play:
    """Play operator: its state z is the centre of a window of half-width r, which q moves when it reaches an edge.

    The initial z is unknown; it differs from the coordinate q by at most r. As soon as q has moved over more than 2
    r, it has moved the window, and z is known.

    Attributes:
        width: Half-width r of the window [rad or m].
    """

    width: float

    def __post_init__(self) -> None:
        if not 0.0 < self.width < float("inf"):
            raise ModelError(f"The half-width of a play operator must be positive; found {self.width}.")

    @property
    def update(self) -> Expression:
        """Expression of the next `state` from the previous `state` z and the new `q`: min(max(z, q - r), q + r)."""
        q = symbol("q")
        return minimum(maximum(symbol("state"), q - self.width), q + self.width)

    @property
    def deflection(self) -> Expression:
        """Expression of the normalised deflection (q - z) / r, from -1 to 1."""
        return (symbol("q") - symbol("state")) * (1.0 / self.width)


@dataclass(frozen=True, slots=True)
class MemoryNode:
    """Node of a hysteresis state: a play operator with the coordinate that drives it; several laws may share a node.

    Attributes:
        coordinate: Coordinate that drives the state.
        memory: Operator that updates the state.
        term: Name of the first torque term that uses the state.
    """

    coordinate: Coordinate
    memory: Play
    term: str
