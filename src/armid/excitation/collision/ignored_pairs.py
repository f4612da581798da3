"""Pairs of bodies that the user excludes from the collision check: by name or pattern, or with an SRDF of MoveIt."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from armid.errors import ArmidError, did_you_mean
from armid.input_boundary import read_text
from armid.robot.collision_body_names import BodyPair, link_of
from armid.robot.joint_selection import matching
from armid.robot.xml import parse_xml


@dataclass(frozen=True, slots=True)
class IgnoredBodies:
    """Names of two links or bodies that need not be kept apart.

    Attributes:
        first: Name of the first link or body, or a pattern (`*`, `?`, `[…]`).
        second: Name of the second link or body, or a pattern.
        reason: Option that excludes the pair; or name of the file that excludes it, with the reason that the file
            gives.
        strict: True if an error is raised for a name that matches no body.
    """

    first: str
    second: str
    reason: str
    strict: bool = True


@dataclass(frozen=True, slots=True)
class IgnoredPair:
    """Two bodies whose distance is not checked: they touch by construction, or the user has excluded the pair.

    Attributes:
        pair: Names of the two bodies.
        share: Share of random poses (0 to 1) in which the two bodies overlap. For the first link and the body on
            which the arm is mounted, it is the share of poses in which they are closer than the required distance.
            NaN if it was not computed.
        reason: Option or file that excludes the pair; empty if the user has not excluded it.
        bodies: Indices of the two bodies among the shapes.
        cause: Reason why bodies that the user has not excluded are not checked; empty if they overlap in most poses.
        adjacent: True if only one joint is between the links of the bodies.
    """

    pair: BodyPair
    share: float
    reason: str
    bodies: tuple[int, int]
    cause: str = ""
    adjacent: bool = False

    @property
    def account(self) -> str:
        """Text with the names of the pair and, in parentheses, what excludes it, or the share of overlap."""
        return f"{self.pair} ({self.reason or f'{100.0 * self.share:.0f} %'})"

    @property
    def why(self) -> str:
        """Reason why the pair is not checked."""
        cause = self.cause or "overlapping in most random poses"
        return self.reason or (f"adjacent links, {cause}" if self.adjacent else cause)


def pairs_by_reason(skipped: Sequence[IgnoredPair]) -> dict[str, list[str]]:
    """Groups pairs that are not checked by reason; several pairs of bodies of the same two links become one entry.

    Returns:
        Names of bodies or links for each reason. If the reason is overlap, the share of random poses in which the
        bodies overlap is given, too.
    """
    found: dict[str, dict[BodyPair, list[IgnoredPair]]] = {}
    for each in skipped:
        found.setdefault(each.why, {}).setdefault(each.pair.links, []).append(each)
    return {
        why: [
            f"{links} ({len(bodies)} pairs of bodies)"
            if len(bodies) > 1
            else bodies[0].account
            if not bodies[0].reason and not bodies[0].cause
            else bodies[0].pair
            for links, bodies in by_links.items()
        ]
        for why, by_links in found.items()
    }


def parse_ignored(text: str) -> IgnoredBodies:
    """Reads the value `A,B` of the option `--ignore-pair`.

    Raises:
        ArmidError: The text does not consist of two names.
    """
    names = [name.strip() for name in text.split(",")]
    if len(names) != 2 or not all(names):
        raise ArmidError(
            f"--ignore-pair {text}: these are not two names.",
            remedy="write two names or patterns, separated by a comma: --ignore-pair A,B.",
        )
    return IgnoredBodies(names[0], names[1], "--ignore-pair")


def ignored_of_srdf(path: Path | str) -> tuple[IgnoredBodies, ...]:
    """Reads the pairs of links whose collisions an SRDF disables.

    Raises:
        ArmidError: The file is missing, is not XML, or disables no collisions.
    """
    path = Path(path)
    root = parse_xml(
        read_text(path, "an SRDF file", remedy="give the SRDF file of the arm's MoveIt package."), str(path)
    )
    found = tuple(
        IgnoredBodies(
            each.get("link1", ""),
            each.get("link2", ""),
            ": ".join(filter(None, (path.name, each.get("reason", "")))),
            strict=False,
        )
        for each in root.iter("disable_collisions")
    )
    if not found:
        raise ArmidError(f"{path} disables no collisions.", remedy="give an SRDF file with <disable_collisions>.")
    return found


def ignored_pairs(
    ignored: Sequence[IgnoredBodies], pairs: Sequence[BodyPair], bodies: Sequence[str]
) -> dict[int, str]:
    """Option or file that excludes a pair, for each excluded pair, by the index of the pair.

    Args:
        ignored: Pairs of names that are excluded.
        pairs: Names of all pairs of bodies.
        bodies: Names of the bodies.

    Raises:
        ArmidError: A name matches no body.
    """
    links = dict.fromkeys(link_of(name) for name in bodies)
    found: dict[int, str] = {}
    for each in ignored:
        sides = [_bodies_of(name, bodies, tuple(links), each) for name in (each.first, each.second)]
        for k, pair in enumerate(pairs):
            a, b = pair.first, pair.second
            if (a in sides[0] and b in sides[1]) or (a in sides[1] and b in sides[0]):
                found.setdefault(k, each.reason)
    return found


def _bodies_of(name: str, bodies: Sequence[str], links: tuple[str, ...], each: IgnoredBodies) -> set[str]:
    """Names of the bodies that a name or pattern selects: bodies of matching links, or bodies with matching names."""
    fitting = set(matching(name, links))
    found = {body for body in bodies if link_of(body) in fitting} or set(matching(name, bodies)) & set(bodies)
    if not found and each.strict:
        raise ArmidError(
            f"{each.reason} {each.first},{each.second}: no body is called {name!r}.",
            possible=", ".join(links),
            remedy=did_you_mean(name, links) or "name one of these links, or give a pattern that fits one of them.",
        )
    return found
