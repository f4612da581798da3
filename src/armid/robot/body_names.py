"""Names of collision bodies and of pairs of them: texts that know the links which have the bodies."""

from __future__ import annotations


class BodyName(str):
    """Name of a body: its link's name, from the link's second body on with a number, as `elbow shape 2`.

    Attributes:
        link: Name of the link.
        number: Number of the body among those of the link, from 1.
    """

    __slots__ = ("link", "number")

    link: str
    number: int

    def __new__(cls, link: str, number: int = 1) -> BodyName:
        """Makes the text of the parts."""
        name = super().__new__(cls, link if number == 1 else f"{link} shape {number}")
        name.link, name.number = link, number
        return name

    def __getnewargs__(self) -> tuple[str, int]:  # pyright: ignore[reportIncompatibleMethodOverride]
        """The parts, of which a copy is made."""
        return self.link, self.number


class BodyPair(str):
    """Names of two bodies, as `elbow shape 2 - base`.

    Attributes:
        first: Name of the one body.
        second: Name of the other.
    """

    __slots__ = ("first", "second")

    first: str
    second: str

    def __new__(cls, first: str, second: str) -> BodyPair:
        """Makes the text of the names."""
        pair = super().__new__(cls, f"{first} - {second}")
        pair.first, pair.second = first, second
        return pair

    def __getnewargs__(self) -> tuple[str, str]:  # pyright: ignore[reportIncompatibleMethodOverride]
        """The names, of which a copy is made."""
        return self.first, self.second

    @property
    def links(self) -> BodyPair:
        """The links that have the bodies."""
        return BodyPair(link_of(self.first), link_of(self.second))


def link_of(body: str) -> str:
    """Link that has a body; a body of the surroundings is its own."""
    return body.link if isinstance(body, BodyName) else body
