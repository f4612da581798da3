"""Names of parameters, made of symbol, number and recording: `FV_1`, `ZZR_2`, `FO_3[1]`."""

from __future__ import annotations

import re
from collections.abc import Iterable

FORM = re.compile(r"(?P<symbol>.+?)(?P<grouped>R?)_(?P<number>\d+)(?:\[(?P<recording>\d+)\])?")
"""A name in text. No symbol of a term ends in R."""


class ParameterName(str):
    """Name of a parameter: the text, which it equals, and the parts that the text is made of.

    Attributes:
        symbol: Symbol of the standard parameter, `ZZ` for `ZZR_1`.
        number: Number of the link or joint, from 1; `None` where there is none.
        recording: Number of the only recording that the parameter belongs to, from 1; `None` for all.
        grouped: Whether others are regrouped into it, marked by an R.
    """

    __slots__ = ("grouped", "number", "recording", "symbol")

    symbol: str
    number: int | None
    recording: int | None
    grouped: bool

    def __new__(
        cls, symbol: str, number: int | None = None, recording: int | None = None, grouped: bool = False
    ) -> ParameterName:
        """Makes the text of the parts."""
        place = "" if number is None else f"_{number}"
        name = super().__new__(cls, symbol + "R" * grouped + place + ("" if recording is None else f"[{recording}]"))
        name.symbol, name.number, name.recording, name.grouped = symbol, number, recording, grouped
        return name

    def __getnewargs__(self) -> tuple[str, int | None, int | None, bool]:  # pyright: ignore[reportIncompatibleMethodOverride]
        """The parts, of which a copy is made."""
        return self.symbol, self.number, self.recording, self.grouped

    @classmethod
    def read(cls, text: str) -> ParameterName:
        """The name that a text stands for; a text of another form is a symbol without a number."""
        if isinstance(text, ParameterName):
            return text
        found = FORM.fullmatch(text)
        if found is None:
            return cls(text)
        recording = None if found["recording"] is None else int(found["recording"])
        return cls(found["symbol"], int(found["number"]), recording, bool(found["grouped"]))

    @property
    def of_all(self) -> ParameterName:
        """The name without its recording: `FV_1` for `FV_1[2]`."""
        return ParameterName(self.symbol, self.number, None, self.grouped)

    def of_recording(self, number: int) -> ParameterName:
        """The same parameter of one recording, counted from 1: `FV_1[2]` for `FV_1`."""
        return ParameterName(self.symbol, self.number, number, self.grouped)

    def regrouped(self) -> ParameterName:
        """The base parameter that others are regrouped into: `ZZR_1` for `ZZ_1`."""
        return ParameterName(self.symbol, self.number, self.recording, True)


def parameter_names(names: Iterable[str]) -> tuple[ParameterName, ...]:
    """Names with their parts, of texts that a file or a caller gives; names that have them stay."""
    return tuple(ParameterName.read(name) for name in names)
