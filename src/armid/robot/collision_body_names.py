"""Names of collision bodies and of pairs of bodies: strings that also contain the names of the links."""

from __future__ import annotations


class BodyName(str):
    """Name of a body: the name of the link, with a number from the second body on, for instance `elbow shape 2`.

    Attributes:
        link: Name of the link to which the body belongs.
        number: Number of the body among the bodies of the link, from 1.
    """

    __slots__ = ("link", "number")

    link: str
    number: int

    def __new__(cls, link: str, number: int = 1) -> BodyName:
        """Makes the name of a body from the name of its link and the number of the body."""
        name = super().__new__(cls, link if number == 1 else f"{link} shape {number}")
        name.link, name.number = link, number
        return name

    def __getnewargs__(self) -> tuple[str, int]:  # pyright: ignore[reportIncompatibleMethodOverride]
        """Link and number: arguments with which `copy` and `pickle` make an equal name."""
        return self.link, self.number


class BodyPair(str):
    """Names of two bodies, for instance `elbow shape 2 - base`.

    Attributes:
        first: Name of the first body.
        second: Name of the second body.
    """

    __slots__ = ("first", "second")

    first: str
    second: str

    def __new__(cls, first: str, second: str) -> BodyPair:
        """Makes the pair from the names of its two bodies."""
        pair = super().__new__(cls, f"{first} - {second}")
        pair.first, pair.second = first, second
        return pair

    def __getnewargs__(self) -> tuple[str, str]:  # pyright: ignore[reportIncompatibleMethodOverride]
        """The two names: arguments with which `copy` and `pickle` make an equal pair."""
        return self.first, self.second

    @property
    def links(self) -> BodyPair:
        """Names of the links to which the two bodies belong."""
        return BodyPair(link_of(self.first), link_of(self.second))


def link_of(body: str) -> str:
    """Name of the link to which a body belongs; for a body of the surroundings, its own name."""
    return body.link if isinstance(body, BodyName) else body
