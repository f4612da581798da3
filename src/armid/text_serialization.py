"""Values that a file holds as their text."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Self


class TextValue(ABC):
    """Value that a file holds as its text, from which `read` makes it again."""

    __slots__ = ()

    @classmethod
    @abstractmethod
    def read(cls, text: str) -> Self:
        """The value that `str` gave this text for."""
