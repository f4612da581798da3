"""Frequency band in which torque and model are compared: one low-pass for both sides, then decimation.

Filtering the torque alone biases the estimate (a filtered sign of velocity is no sign of velocity), so the filter
is a value that travels with the observations and is applied to torque and regressor columns alike.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from armid.errors import ArmidError

Family = Literal["butterworth", "fir", "none"]
Edges = Literal["drop", "periodic", "pad"]


@dataclass(frozen=True, slots=True)
class Band:
    """Zero-phase low-pass filter, not yet applied.

    Attributes:
        family: `butterworth` (forward and backward, -6 dB at the cut-off), `fir` (linear phase) or `none`.
        cutoff: Cut-off frequency [Hz]; ignored for `none`.
        order: Order of one Butterworth pass, or number of cut-off periods that the FIR spans.
        edges: `periodic` where the run is a whole number of periods, `pad` extends the ends by odd reflection
            and keeps them, `drop` does the same and drops the rows that the ends reach.
        columns: Filter the regressor columns too. `False` filters the torque alone, which is biased and kept
            only to reproduce published results.
    """

    family: Family = "none"
    cutoff: float = 0.0
    order: int = 4
    edges: Edges = "drop"
    columns: bool = True

    def __post_init__(self) -> None:
        if self.family not in ("butterworth", "fir", "none"):
            raise ArmidError(f"Unknown filter family {self.family!r}.", possible="butterworth, fir, none")
        if self.edges not in ("drop", "periodic", "pad"):
            raise ArmidError(f"Unknown treatment of edges {self.edges!r}.", possible="drop, periodic, pad")
        if self.family != "none" and not (self.cutoff > 0 and self.order >= 1):
            raise ArmidError(
                f"A {self.family} filter needs a cut-off above zero and an order of at least one; found "
                f"{self.cutoff} Hz and {self.order}."
            )

    @property
    def is_open(self) -> bool:
        """Tests whether the band filters nothing."""
        return self.family == "none"
