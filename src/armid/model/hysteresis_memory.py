"""Hysteresis states of torque laws, which depend on the motion before the present sample.

The state of a memory node is updated from sample to sample along a contiguous run. Its initial value is unknown, so a
state is used only from the sample on at which all initial values have led to the same state.
"""

from __future__ import annotations

from dataclasses import dataclass

from armid.errors import ModelError
from armid.model.expression import Expression, maximum, minimum, symbol

Coordinate = tuple[tuple[int, float], ...]
"""Pairs of joint index and weight w_j of a coordinate c = Σ w_j q_j."""


@dataclass(frozen=True, slots=True)
class Play:
    """Play operator: the centre z of a window of half-width r that the coordinate q drags along.

    The initial z is unknown within r of q. It is known once q has moved over more than 2 r and so has dragged it.

    Attributes:
        width: Half-width r of the window [rad or m].
    """

    width: float

    def __post_init__(self) -> None:
        if not 0.0 < self.width < float("inf"):
            raise ModelError(f"The width of a play operator must be positive; found {self.width}.")

    @property
    def update(self) -> Expression:
        """Next `state` from the last one and the new `q`: min(max(z, q - r), q + r)."""
        q = symbol("q")
        return minimum(maximum(symbol("state"), q - self.width), q + self.width)

    @property
    def deflection(self) -> Expression:
        """(q - z) / r, from -1 to 1."""
        return (symbol("q") - symbol("state")) * (1.0 / self.width)


@dataclass(frozen=True, slots=True)
class MemoryNode:
    """Hysteresis state of a model: an operator and the coordinate that drives it, shared by laws.

    Attributes:
        coordinate: Coordinate that drives the state.
        memory: Operator that updates the state.
        term: Name of the first term that uses it.
    """

    coordinate: Coordinate
    memory: Play
    term: str
