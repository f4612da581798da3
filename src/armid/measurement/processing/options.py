"""Options for the processing of recordings; they are the keys of the table `[processing]` of a study."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

from armid.errors import StudyError, did_you_mean
from armid.measurement.low_pass_band import Band, Edges, Family
from armid.remedy import Remedy, setting

Derivatives = Literal["given", "velocity", "central", "periodic", "filter"]
Standstill = Literal["drop", "keep", "moving"]


@dataclass(frozen=True, slots=True)
class ProcessingOptions:
    """Options for processing recordings before they are compared with a model.

    Attributes:
        cutoff: Cut-off of the band in which torque and model are compared [Hz]; with `auto` it is determined from the
            motion.
        order: Order of one of the two Butterworth passes (forwards and backwards), or length of the FIR filter in
            periods of the cut-off.
        family: `butterworth`, `fir`, or `none`: nothing is filtered.
        columns: True if the columns of the model are filtered in the same way as the torque. `False` biases the
            estimate; it exists only to reproduce published results.
        decimate: Rate of the rows after the filter [Hz]. If it is 0, or with the family `none`, every sample is a
            row.
        derivatives: `given` uses the recorded positions, velocities and accelerations without a filter; `velocity`
            filters recorded positions and velocities, and differentiates the velocities once; the other values filter
            the positions and differentiate them twice: `central` by three-point differences, `periodic` in the
            frequency domain (with periodic edges), `filter` by the filter itself (its frequency response times jω).
            If it is not given, all recorded quantities are used, which means `given`, `velocity` or `central`.
        edges: `drop` leaves out the rows at each end that depend on values beyond the end; `pad` keeps these rows;
            `periodic` is exact if the run is a whole number of periods.
        trim: Shortest time that is left out at each end [s]. If it is not given: 0.5, or 0 if edges are `pad` or
            `periodic`.
        slow: Smallest speed of a joint [rad/s or m/s] at which a row is used for this joint.
        motion_cutoff: Cut-off of the filter of the positions [Hz], if it differs from `cutoff`.
        average: True if the repetitions of a periodic motion are aligned and only their mean is used.
        saturation: Share of the effort limit of a joint; rows near samples whose effort reaches this share are not
            used for this joint. Rows near a plateau (many samples with the same extreme effort) are not used either.
            With `keep`, all rows are used.
        standstill: `drop` leaves out, for each joint, the rows that are affected by its standstill while other joints
            move, or between two motions, because static friction can have any value up to its bound there. `moving`
            also leaves out longer rests before, between and after motions, even if few rows remain. `keep` keeps all
            rows.
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
    saturation: float | Literal["keep"] | None = None
    standstill: Standstill = "drop"

    def __post_init__(self) -> None:
        _choice("family", self.family, ("butterworth", "fir", "none"))
        _choice("edges", self.edges, ("drop", "periodic", "pad"))
        _choice("standstill", self.standstill, ("drop", "keep", "moving"))
        _choice("derivatives", self.derivatives, ("given", "velocity", "central", "periodic", "filter", None))
        for name in ("columns", "average"):
            _choice(name, getattr(self, name), (True, False))
        if isinstance(self.order, bool) or not isinstance(self.order, int) or self.order < 1:  # pyright: ignore[reportUnnecessaryIsInstance]
            raise StudyError(f"`order` must be a whole number above 0; found {self.order!r}.")
        if self.cutoff != "auto":
            _number(self, "cutoff", zero=self.family == "none", also='or "auto"')
        _number(self, "decimate", zero=True)
        _number(self, "slow", zero=True)
        for name in ("trim", "motion_cutoff", "saturation"):
            if getattr(self, name) is not None and (name, getattr(self, name)) != ("saturation", "keep"):
                _number(self, name, zero=name == "trim", also='or "keep"' if name == "saturation" else "")
        self._check_sense()

    def _check_sense(self) -> None:
        """Raises an error if options contradict each other."""
        if isinstance(self.saturation, float) and self.saturation > 1:
            raise StudyError(
                f'`saturation` is a share of the effort limit, at most 1, or "keep"; found {self.saturation}.'
            )
        if self.average and self.edges != "periodic":
            raise StudyError(
                '`average = true` needs `edges = "periodic"`, because the mean of the repetitions is one '
                f'closed period; found edges = "{self.edges}".',
                remedy=Remedy("use ", setting("edges", "periodic"), ", or average = false to keep all repetitions."),
            )
        if self.derivatives == "periodic" and self.edges != "periodic":
            raise StudyError(
                f'derivatives = "periodic" needs edges = "periodic"; found "{self.edges}".',
                remedy='use derivatives = "filter", which does not need periodic edges.',
            )
        if self.derivatives == "filter" and self.family == "none":
            raise StudyError(
                'derivatives = "filter" computes derivatives with the filter, but family = "none" means that there '
                "is no filter.",
                remedy='use family = "butterworth" or "fir", or derivatives = "central".',
            )

    @property
    def needs_all_samples(self) -> bool:
        """True if the rate of recordings must not be reduced.

        Each sample is a row, the torque alone is filtered, or the samples at both ends belong to whole periods.
        """
        return self.family == "none" or self.decimate == 0.0 or not self.columns or self.edges == "periodic"

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
                'The option cutoff = "auto" has not yet been replaced by a frequency that is computed from the '
                "motion.",
                remedy="call armid.measurement.processing.pipeline.process_recordings, which determines the "
                "cut-off, or give it in Hz.",
            )
        return Band(self.family, self.cutoff, self.order, self.edges, self.columns)


def _choice(name: str, value: object, known: tuple[object, ...]) -> None:
    if not any(value is one or (isinstance(value, str) and value == one) for one in known):
        raise StudyError(
            f"{name} = {value!r} is not known.",
            possible=", ".join(str(one) for one in known if one is not None),
            remedy=did_you_mean(value, [str(one) for one in known if one is not None]),
        )


def _number(processing: ProcessingOptions, name: str, *, zero: bool, also: str = "") -> None:
    """Checks that an option is a finite and positive number (or zero, if allowed) and converts it to a float."""
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
"""Options of section 3.2.2 of the thesis: mean of the repetitions; Butterworth filter of order 20, at 3 Hz for
positions and at 3.5 Hz for torques, but none for the model; central differences. The thesis does not give the
treatment of edges and the rate of rows; rows at 100 Hz change the result less than the treatment of the edges."""
