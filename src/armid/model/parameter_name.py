"""Names of parameters, made of symbol, number and recording, for instance `FV_1`, `ZZR_2`, `FO_3[1]`."""

from __future__ import annotations

import re
from collections.abc import Iterable

FORM = re.compile(r"(?P<symbol>.+?)(?P<grouped>R?)_(?P<number>\d+)(?:\[(?P<recording>\d+)\])?")
"""Pattern of a parameter name. No symbol of a torque term ends in R, so a final R marks a regrouped parameter."""


class ParameterName(str):
    """Name of a parameter: a string with its parts (symbol, number, recording) as attributes.

    Attributes:
        symbol: Symbol of the standard parameter, for instance `ZZ` for `ZZR_1`.
        number: Number of the link or joint, counted from 1; `None` if there is none.
        recording: Number of the recording to which the parameter belongs, counted from 1; `None` if it belongs to all
            recordings.
        grouped: True if other parameters have been added to this one by regrouping; the name then has the letter R.
    """

    __slots__ = ("grouped", "number", "recording", "symbol")

    symbol: str
    number: int | None
    recording: int | None
    grouped: bool

    def __new__(
        cls, symbol: str, number: int | None = None, recording: int | None = None, grouped: bool = False
    ) -> ParameterName:
        """Creates the string from the parts."""
        place = "" if number is None else f"_{number}"
        name = super().__new__(cls, symbol + "R" * grouped + place + ("" if recording is None else f"[{recording}]"))
        name.symbol, name.number, name.recording, name.grouped = symbol, number, recording, grouped
        return name

    def __getnewargs__(self) -> tuple[str, int | None, int | None, bool]:  # pyright: ignore[reportIncompatibleMethodOverride]
        """Arguments of `__new__` with which copies and unpickled objects are created."""
        return self.symbol, self.number, self.recording, self.grouped

    @classmethod
    def read(cls, text: str) -> ParameterName:
        """Reads a name from a text; a text that does not match `FORM` is taken as a symbol without a number."""
        if isinstance(text, ParameterName):
            return text
        found = FORM.fullmatch(text)
        if found is None:
            return cls(text)
        recording = None if found["recording"] is None else int(found["recording"])
        return cls(found["symbol"], int(found["number"]), recording, bool(found["grouped"]))

    @property
    def of_all(self) -> ParameterName:
        """Name without the number of the recording: `FV_1` for `FV_1[2]`."""
        return ParameterName(self.symbol, self.number, None, self.grouped)

    def of_recording(self, number: int) -> ParameterName:
        """Name of the same parameter for one recording, counted from 1: `FV_1[2]` for `FV_1`."""
        return ParameterName(self.symbol, self.number, number, self.grouped)

    def regrouped(self) -> ParameterName:
        """Name with the letter R, for a parameter to which others have been added: `ZZR_1` for `ZZ_1`."""
        return ParameterName(self.symbol, self.number, self.recording, True)


def parameter_names(names: Iterable[str]) -> tuple[ParameterName, ...]:
    """Reads names from texts; a `ParameterName` is returned unchanged."""
    return tuple(ParameterName.read(name) for name in names)
