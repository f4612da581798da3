"""Values that are stored in files as text."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Self


class TextValue(ABC):
    """Value that is stored in files as its text `str(value)`; `read` makes the value from this text."""

    __slots__ = ()

    @classmethod
    @abstractmethod
    def read(cls, text: str) -> Self:
        """Makes the value from its text."""
