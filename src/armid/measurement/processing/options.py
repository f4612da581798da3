"""Options of processing; keys of a study's `[processing]`."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

from armid.errors import StudyError
from armid.measurement.low_pass_band import Band, Edges, Family
from armid.remedy import Remedy, setting

Derivatives = Literal["given", "velocity", "central", "periodic", "filter"]
Standstill = Literal["drop", "keep", "moving"]


@dataclass(frozen=True, slots=True)
class ProcessingOptions:
    """Options for processing recordings before they are compared with a model.

    Attributes:
        cutoff: Cut-off of the band in which torque and model are compared [Hz]; `auto` finds it from the motion.
        order: Order of one Butterworth pass (of two, forwards and backwards), or length of the FIR in cut-off
            periods.
        family: `butterworth`, `fir`, or `none`: nothing is filtered.
        columns: The same filter on the model's columns as on the torque. `False` biases the estimate and is kept
            to reproduce published results.
        decimate: Rows a second after the filter [Hz]; 0 keeps every sample, as does the family `none`.
        derivatives: `given` uses recorded velocities and accelerations as they stand, with positions unfiltered;
            `velocity` filters recorded positions and velocities and differentiates the latter once; the others
            filter the positions and differentiate them twice: `central` by three-point differences, `periodic`
            in the frequency domain where the edges are periodic, `filter` by the filter itself (its frequency
            response times jω). Not said: what is recorded is used, so `given`, `velocity` or `central`.
        edges: `drop` leaves out the rows at each end that lean on what lies beyond; `pad` keeps them; `periodic`
            is exact where the motion is a whole number of periods.
        trim: Seconds left out at each end at least; not said: 0.5, and 0 where edges are padded or periodic.
        slow: Rows count for a joint only while it moves at least this fast [rad/s or m/s].
        motion_cutoff: Cut-off for the positions [Hz], where it differs from `cutoff`.
        average: The mean of all repetitions of a periodic motion is used, aligned, instead of each of them.
        saturation: Rows near a sample whose effort reaches this share of the joint's limit do not count.
        standstill: `drop` leaves out, for a joint that stands still between motion, the rows that this reaches: dry
            friction may have any value up to its bound there. `moving` leaves out its longer rests as well, before,
            between and after motions, however few rows remain. `keep` keeps all rows.
    """

    cutoff: float | Literal["auto"] = 5.0
    order: int = 4
    family: Family = "butterworth"
    columns: bool = True
    decimate: float = 25.0
    derivatives: Derivatives | None = None
    edges: Edges = "drop"
    trim: float | None = None
    slow: float = 0.0
    motion_cutoff: float | None = None
    average: bool = False
    saturation: float | None = None
    standstill: Standstill = "drop"

    def __post_init__(self) -> None:
        _choice("family", self.family, ("butterworth", "fir", "none"))
        _choice("edges", self.edges, ("drop", "periodic", "pad"))
        _choice("standstill", self.standstill, ("drop", "keep", "moving"))
        _choice("derivatives", self.derivatives, ("given", "velocity", "central", "periodic", "filter", None))
        for name in ("columns", "average"):
            _choice(name, getattr(self, name), (True, False))
        if isinstance(self.order, bool) or not isinstance(self.order, int) or self.order < 1:  # pyright: ignore[reportUnnecessaryIsInstance]
            raise StudyError(f"order must be a whole number above 0; found {self.order!r}.")
        if self.cutoff != "auto":
            _number(self, "cutoff", zero=self.family == "none", also='or "auto"')
        _number(self, "decimate", zero=True)
        _number(self, "slow", zero=True)
        for name in ("trim", "motion_cutoff", "saturation"):
            if getattr(self, name) is not None:
                _number(self, name, zero=name == "trim")
        self._check_sense()

    def _check_sense(self) -> None:
        """Raises an error for options that contradict each other."""
        if self.saturation is not None and self.saturation > 1:
            raise StudyError(f"saturation is a share of the limit, at most 1; found {self.saturation}.")
        if self.average and self.edges != "periodic":
            raise StudyError(
                f'average gives one period, which has no ends to {self.edges}; edges = "{self.edges}".',
                remedy=Remedy("use ", setting("edges", "periodic"), ", or average = false to keep each repetition."),
            )
        if self.derivatives == "periodic" and self.edges != "periodic":
            raise StudyError(
                f'derivatives = "periodic" needs edges = "periodic"; found "{self.edges}".',
                remedy='use derivatives = "filter", which needs no period.',
            )
        if self.derivatives == "filter" and self.family == "none":
            raise StudyError(
                'derivatives = "filter" differentiates by the filter, but family = "none".',
                remedy='choose a family, or derivatives = "central".',
            )

    @property
    def band(self) -> Band:
        """Band in which torque and model are compared.

        Raises:
            StudyError: The cut-off is still `auto`.
        """
        if self.family == "none":
            return Band()
        if self.cutoff == "auto":
            raise StudyError(
                'cutoff = "auto" is not yet found from a motion.',
                remedy="find it with armid.measurement.processing.pipeline.process_recordings, or give it in Hz.",
            )
        return Band(self.family, self.cutoff, self.order, self.edges, self.columns)


def _choice(name: str, value: object, known: tuple[object, ...]) -> None:
    if not any(value is one or (isinstance(value, str) and value == one) for one in known):
        raise StudyError(
            f"{name} = {value!r} is not known.",
            possible=", ".join(str(one) for one in known if one is not None),
        )


def _number(processing: ProcessingOptions, name: str, *, zero: bool, also: str = "") -> None:
    """Converts an option to a float that is finite and positive (or zero)."""
    value: Any = getattr(processing, name)
    good = isinstance(value, int | float) and not isinstance(value, bool)
    if not good or not (0 < value < float("inf") or (zero and value == 0)):
        least = f"{'from 0 on' if zero else 'above 0'} {also}".rstrip()
        raise StudyError(f"{name} must be a number {least}; found {value!r}.")
    object.__setattr__(processing, name, float(value))


THESIS = ProcessingOptions(
    cutoff=3.5,
    order=20,
    columns=False,
    decimate=100.0,
    derivatives="central",
    edges="periodic",
    trim=0.0,
    motion_cutoff=3.0,
    average=True,
    standstill="keep",
)
"""Section 3.2.2 of the thesis: mean of the repetitions, Butterworth of order 20 at 3 Hz for positions and 3.5 Hz
for torques but not for the model, central differences. Its text is silent on edges and on rows a second; rows at
100 Hz change the result less than the treatment of the edges does."""
