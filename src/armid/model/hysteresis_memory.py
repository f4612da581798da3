"""Memory of a torque law: what a law may know of the motion before the sample that it is evaluated at.

A node of memory has a state that is updated from one sample of a contiguous run to the next. What it was before the
run began is not known, so a state counts only from the sample on at which every beginning has led to the same.
"""

from __future__ import annotations

from dataclasses import dataclass

from armid.errors import ModelError
from armid.model.expression import Expression, maximum, minimum, symbol

__all__ = ["Coordinate", "MemoryNode", "Play"]

Coordinate = tuple[tuple[int, float], ...]
"""Pairs of joint index and weight w_j of a coordinate c = Σ w_j q_j."""


@dataclass(frozen=True, slots=True)
class Play:
    """A play operator: the centre z of a window of half-width r that the coordinate drags along.

    z begins anywhere within r of q. It is known once q has swept more than 2 r, since it has then been dragged.

    Attributes:
        width: Half-width r of the window [rad or m].
    """

    width: float

    def __post_init__(self) -> None:
        if not 0.0 < self.width < float("inf"):
            raise ModelError(f"The width of a play must be positive; found {self.width}.")

    @property
    def update(self) -> Expression:
        """The next `state`, from the last one and the new `q`: min(max(z, q - r), q + r)."""
        q = symbol("q")
        return minimum(maximum(symbol("state"), q - self.width), q + self.width)

    @property
    def deflection(self) -> Expression:
        """(q - z) / r, from -1 to 1."""
        return (symbol("q") - symbol("state")) * (1.0 / self.width)


@dataclass(frozen=True, slots=True)
class MemoryNode:
    """One state of a model: a memory and the coordinate that drives it. Laws of one coordinate may share it.

    Attributes:
        coordinate: What drives it.
        memory: How its state follows.
        term: Name of the first term that asks for it.
    """

    coordinate: Coordinate
    memory: Play
    term: str
