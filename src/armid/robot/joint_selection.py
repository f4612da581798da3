"""Joints of a description, and the selection of the joints that are locked."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from fnmatch import fnmatchcase

from armid.errors import Finding, RobotError, did_you_mean


@dataclass(frozen=True, slots=True)
class Follows:
    """Law of a mimic joint, whose position depends on that of another joint.

    Attributes:
        leader: Name of the joint on whose position that of the mimic joint depends; empty if the mimic joint has a
            constant position.
        factors: Coefficients of the polynomial in the position of the joint `leader`, lowest power first.
    """

    leader: str
    factors: tuple[float, ...]

    def at(self, position: float) -> float:
        """Position of the mimic joint [rad or m] for a position of the joint `leader`."""
        return float(sum(c * position**k for k, c in enumerate(self.factors)))


@dataclass(frozen=True, slots=True)
class SelectedJoint:
    """Joint of a description that is not a fixed joint.

    Attributes:
        name: Name of the joint.
        parent: Index of the joint whose link carries this joint; -1 for the base.
        is_simple: True if the joint has one degree of freedom.
        lower: Lowest position [rad or m].
        upper: Highest position [rad or m].
        follows: Law of a mimic joint; `None` if the joint is independent.
    """

    name: str
    parent: int
    is_simple: bool = True
    lower: float = -math.inf
    upper: float = math.inf
    follows: Follows | None = None

    @property
    def rest(self) -> float:
        """Position within the limits that is nearest to zero [rad or m]: the joint is locked there by default."""
        if not self.is_simple or self.lower > self.upper:
            return 0.0
        return min(max(0.0, self.lower), self.upper)


@dataclass(frozen=True, slots=True)
class JointOutline:
    """All joints of a description, parents before children, and the joint that moves each frame.

    Attributes:
        joints: The joints that are not fixed joints.
        frames: Index of the joint that moves each link, body or site, by name; -1 if none does.
    """

    joints: tuple[SelectedJoint, ...]
    frames: Mapping[str, int] = field(default_factory=dict[str, int])

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the joints."""
        return tuple(joint.name for joint in self.joints)

    def chain(self, frame: str) -> set[str]:
        """Names of the joints between the base and a frame."""
        found, k = set[str](), self.frames[frame]
        while k >= 0 and self.joints[k].name not in found:
            found.add(self.joints[k].name)
            k = self.joints[k].parent
        return found


@dataclass(frozen=True, slots=True)
class HeldJoint:
    """Positions of the joints that are locked.

    Attributes:
        at: Positions of the locked joints [rad or m], by name.
        findings: Findings about joints that are locked although they were not named.
    """

    at: Mapping[str, float]
    findings: tuple[Finding, ...] = ()


def matching(pattern: str, names: Iterable[str]) -> list[str]:
    """Names that match a pattern (`*`, `?`, `[…]`); if the pattern itself is one of the names, only this name."""
    names = list(names)
    return [pattern] if pattern in names else [name for name in names if fnmatchcase(name, pattern)]


def held_joints(
    outline: JointOutline, source: str, lock: Mapping[str, float | None], only: Sequence[str], tip: str | None
) -> HeldJoint:
    """Selects the joints to lock, so that the remaining joints are independent of each other.

    Args:
        outline: Joints of the description.
        source: Path of the description, for messages.
        lock: Positions [rad or m] by name or pattern (`*`, `?`, `[…]`). `None` stands for the position within the
            limits that is nearest to zero. A name takes precedence over a pattern, and a later pattern over an
            earlier one.
        only: Names or patterns of the joints that move; if empty, `tip` selects them.
        tip: Name of a frame: the joints between the base and this frame move. If `None`, all joints move.

    Raises:
        RobotError: No joint matches a name or pattern, the frame does not exist, or no joint remains movable.
    """
    if tip is not None and tip not in outline.frames:
        raise RobotError(
            f"{source} has no frame {tip!r} for the tip.",
            possible=", ".join(outline.frames),
            remedy=did_you_mean(tip, outline.frames) or "give the name of a link.",
        )
    at: dict[str, float] = {}
    beyond: dict[str, Finding | None] = {}
    for pattern in sorted(lock, key=lambda each: each in outline.names):
        value = lock[pattern]
        for joint in _fitting(outline, pattern, source, "to lock"):
            at[joint.name] = joint.rest if value is None else value
            beyond[joint.name] = _outside(joint, at[joint.name])
    locked = set(at)
    if only:
        moving = {joint.name for pattern in only for joint in _fitting(outline, pattern, source, "to move")}
    else:
        moving = set(outline.names) if tip is None else outline.chain(tip)
    others = [joint for joint in outline.joints if joint.name not in moving and joint.name not in at]
    # Joints that carry the base of an arm chosen by its tip, such as a floating joint, are locked as well.
    by_tip = tip is not None and not only
    floating = [j for j in outline.joints if by_tip and not j.is_simple and j.name in moving and j.name not in at]
    chosen = [*others, *floating]
    free = [joint for joint in chosen if joint.follows is None]
    at |= {joint.name: joint.rest for joint in free}
    led, findings = _followers(outline, at)
    at |= led
    if not set(outline.names) - set(at) and outline.joints:
        raise RobotError(
            f"{source}: no movable joint remains; all of its {len(outline.joints)} joints are locked.",
            possible=", ".join(outline.names),
            remedy="change --only, --tip or --lock so that a joint stays movable; mimic joints are always locked.",
        )
    loose = [joint.name for joint in outline.joints if not joint.is_simple and joint.name not in at]
    if len(loose) > 1:  # the reader reports a single one with its kind
        raise RobotError(
            f"{source}: the joints {', '.join(map(repr, loose))} do not have exactly one degree of freedom.",
            remedy=f"lock them (--lock {','.join(loose)}), or select one arm with --tip LINK.",
        )
    if free:
        by_name = [name + (f" at {at[name]:.4g}" if at[name] else "") for name in outline.names if name in locked]
        findings = (_said(free, by_name, len(led), outline, by_tip=by_tip), *findings)
    return HeldJoint(at, (*findings, *filter(None, beyond.values())))


def _outside(joint: SelectedJoint, value: float) -> Finding | None:
    """Finding about a locked position [rad or m] outside the limits of the joint; `None` if it is inside."""
    if not joint.is_simple or joint.lower > joint.upper or joint.lower <= value <= joint.upper:
        return None
    what = f"locked at {value:.4g}, outside of its limits {joint.lower:.4g} to {joint.upper:.4g} (rad or m)"
    return Finding(
        "lock-outside-limits",
        "warning",
        joint.name,
        what,
        f"lock it at its position in the recordings: --lock {joint.name}=POSITION.",
    )


def _fitting(outline: JointOutline, pattern: str, source: str, purpose: str) -> list[SelectedJoint]:
    """Joint whose name is `pattern`, or the joints whose names match it; an error is raised if there are none."""
    found = matching(pattern, outline.names)
    if found:
        return [joint for joint in outline.joints if joint.name in found]
    is_pattern = any(sign in pattern for sign in "*?[")
    raise RobotError(
        f"{source} has no joint {'that matches ' if is_pattern else ''}{pattern!r} {purpose}.",
        possible=", ".join(outline.names),
        remedy=did_you_mean(pattern, outline.names) or "use names of the description; * stands for any text.",
    )


def _followers(outline: JointOutline, at: Mapping[str, float]) -> tuple[dict[str, float], tuple[Finding, ...]]:
    """Positions at which the mimic joints are locked, by name [rad or m], and findings about these joints."""
    by_name = {joint.name: joint for joint in outline.joints}

    def position(name: str, seen: tuple[str, ...] = ()) -> float:
        joint = by_name.get(name)
        if joint is None or name in seen:
            return 0.0
        if name in at or joint.follows is None:
            return at.get(name, joint.rest)
        return joint.follows.at(position(joint.follows.leader, (*seen, name)))

    def leads(name: str, seen: tuple[str, ...] = ()) -> str:
        """Independent joint on which a chain of mimic joints depends; empty if the chain is locked."""
        joint = by_name.get(name)
        if joint is None or name in at or name in seen:
            return ""
        return name if joint.follows is None else leads(joint.follows.leader, (*seen, name))

    led = {joint.name: position(joint.name) for joint in outline.joints if joint.follows and joint.name not in at}
    moved: dict[str, list[str]] = {}
    for name in led:
        moved.setdefault(leads(name), []).append(name)
    findings: list[Finding] = []
    for leader, names in moved.items():
        where = ", ".join(f"{name} at {led[name]:.4g}" for name in names)
        if leader:
            what = f"joints that mimic {leader} move with it, but the model keeps them locked (rad or m): {where}"
            advice = f"lock {leader}, too, if it does not move in the recordings"
            findings.append(Finding("joint-follows", "info", leader, what, advice))
        else:
            what = f"these joints mimic locked joints, so they are locked, too (rad or m): {where}"
            findings.append(Finding("joint-follows", "info", "", what))
    return led, tuple(findings)


MANY = 5
"""Largest number of locked joints that a finding lists. If more joints are locked, it lists first the joints that are
not locked at zero."""


def _said(
    free: Sequence[SelectedJoint], locked: Sequence[str], led: int, outline: JointOutline, *, by_tip: bool
) -> Finding:
    """Finding about joints that are locked because other joints were selected to move."""
    chosen = {joint.name for joint in sorted(free, key=lambda joint: not joint.rest)[:MANY]}
    listed = [joint for joint in free if joint.name in chosen]
    names = [joint.name + (f" at {joint.rest:.4g}" if joint.rest else "") for joint in listed]
    more = f" and {len(free) - len(listed)} more" if len(listed) < len(free) else ""
    held = len(free) + len(locked) + led
    total = len(outline.joints)
    following = f", {led} of them because {'it mimics' if led == 1 else 'they mimic'} others" if led else ""
    what = f"{total - held} of {total} joints move; the other {held} are locked{following}, at position 0 unless "
    what += "the list shows another (rad or m): "
    by_name = locked if len(locked) <= MANY else sorted(locked, key=lambda name: " at " not in name)[:MANY]
    others = f" and {len(locked) - len(by_name)} more" if len(by_name) < len(locked) else ""
    as_asked = f"{', '.join(by_name)}{others} (by name), " if locked else ""
    remedy = (
        "if joints between base and tip do not move either, lock them with --lock, or leave them out of --only."
        if by_tip
        else ""
    )
    return Finding("joints-held", "info", "", f"{what}{as_asked}{', '.join(names)}{more}", remedy)
