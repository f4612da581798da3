"""Frequency band in which torque and model are compared: one low-pass filter for both, then decimation.

If only the torque were filtered, the estimate would be biased, because a filtered friction torque no longer follows
the sign of the velocity. The filter is therefore stored with the observations and applied both to the torque and to
the regressor columns.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from armid.errors import ArmidError, did_you_mean

Family = Literal["butterworth", "fir", "none"]
Edges = Literal["drop", "periodic", "pad"]


@dataclass(frozen=True, slots=True)
class Band:
    """Zero-phase low-pass filter for torque and regressor columns; the observations are stored without its effect.

    Attributes:
        family: `butterworth` (forward and backward, -6 dB at the cut-off), `fir` (linear phase) or `none`.
        cutoff: Cut-off frequency [Hz]; ignored for `none`.
        order: Order of one Butterworth pass, or length of the FIR filter in periods of the cut-off frequency.
        edges: Treatment of the ends of a run. `periodic`: the run is a whole number of periods and continued
            periodically. `pad`: the run is extended by odd reflection and all rows are kept. `drop`: as `pad`, but
            the rows that the ends influence are dropped.
        columns: True if the regressor columns are filtered, too. With `False` only the torque is filtered; this
            biases the estimate, and it exists only to reproduce published results.
    """

    family: Family = "none"
    cutoff: float = 0.0
    order: int = 4
    edges: Edges = "drop"
    columns: bool = True

    def __post_init__(self) -> None:
        if self.family not in ("butterworth", "fir", "none"):
            raise ArmidError(
                f"Unknown filter family {self.family!r}.",
                possible="butterworth, fir, none",
                remedy=did_you_mean(self.family, ("butterworth", "fir", "none")),
            )
        if self.edges not in ("drop", "periodic", "pad"):
            raise ArmidError(
                f"Unknown treatment of edges {self.edges!r}.",
                possible="drop, periodic, pad",
                remedy=did_you_mean(self.edges, ("drop", "periodic", "pad")),
            )
        if self.family != "none" and not (self.cutoff > 0 and self.order >= 1):
            raise ArmidError(
                f"A {self.family} filter needs a cut-off above zero and an order of at least one; found a cut-off of "
                f"{self.cutoff} Hz and an order of {self.order}."
            )

    @property
    def is_open(self) -> bool:
        """True if the band has no filter (family `none`)."""
        return self.family == "none"
