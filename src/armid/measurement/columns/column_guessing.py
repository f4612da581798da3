"""Guesses of the quantity and the joint of each column, from patterns of names in common use.

Only the names are used, except that a clock may also be found by its values. Measured columns are preferred to
commanded columns. If two sets of columns fit equally well, an error asks the user to choose.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

from armid.errors import RecordingError
from armid.measurement.columns.clocks import ClockRequest, Values, clock_columns
from armid.measurement.columns.column_name_parsing import ColumnName, clock_of, named, words

MOTION = ("q", "dq", "ddq")

Channel = str | int

_Form = tuple[str, tuple[str, ...], bool, int]
"""Key of a group of columns: quantity, words of the names, true if the channels are numbers, and a number that
distinguishes groups with equal names."""


@dataclass(frozen=True, slots=True)
class Guess:
    """Columns that were guessed from their names.

    Attributes:
        columns: Names of the columns of each quantity for which columns were found. Time may have two columns,
            seconds and nanoseconds.
        joints: Labels of the joints in the order of the columns; empty if the columns are numbered.
        reasons: Reason for each guess, as text.
        commanded: Quantities for which only commanded columns were found.
        undecided: Sets of columns that may all contain the commanded position, so that none was chosen.
    """

    columns: Mapping[str, tuple[str, ...]]
    joints: tuple[str, ...] = ()
    reasons: tuple[str, ...] = ()
    commanded: tuple[str, ...] = ()
    undecided: tuple[tuple[str, ...], ...] = ()


@dataclass(frozen=True, slots=True)
class _Group:
    """Group of columns whose names differ only in the channel.

    Attributes:
        quantity: Quantity of the columns; currents count as effort.
        of_current: True if the columns contain currents.
        members: Parsed column names by channel (name or number of the joint).
    """

    quantity: str
    of_current: bool
    members: Mapping[Channel, ColumnName] = field(default_factory=dict[Channel, ColumnName])

    @property
    def by_name(self) -> bool:
        return any(channel and isinstance(channel, str) for channel in self.members)

    @property
    def first(self) -> ColumnName:
        return next(iter(self.members.values()))

    @property
    def columns(self) -> tuple[str, ...]:
        return tuple(each.column for each in self.members.values())


def guess_columns(
    names: Sequence[str],
    quantities: Sequence[str],
    *,
    wanted: Sequence[str] = (),
    labels: Sequence[str] = (),
    channels: int = 0,
    matrices: bool = False,
    in_file_order: bool = False,
    values: Values | None = None,
) -> Guess | ClockRequest:
    """Guesses which columns contain the given quantities.

    Args:
        names: All columns.
        quantities: Quantities to guess, a selection of `time`, `q`, `dq`, `ddq`, `effort`, `command`.
        wanted: Names of the arm's joints in the file; empty if they are unknown.
        labels: Names that the joints of the description, including locked joints, have in the file, in the order of
            the description.
        channels: Number of columns of positions, if these are already known. Columns of other quantities must then
            have channel numbers.
        matrices: True if one variable of the file may contain all channels as a matrix.
        in_file_order: True if columns with names of joints are returned in the order of the file.
        values: Function that returns the numbers of a column. It is used to test whether a column with a unit of time
            is a clock, and whether a command consists of numbers.

    Returns:
        Guess for as many quantities as possible; if several choices fit equally well, a `ClockRequest` that contains
        them.
    """
    labels = tuple(labels) or tuple(wanted)
    groups = _groups(names, sorted(labels, key=lambda label: -len(words(label))), matrices=matrices)
    usable = [group for group in groups if _is_whole(group, wanted, matrices=matrices)]
    columns: dict[str, tuple[str, ...]] = {}
    reasons: list[str] = []
    time = clock_columns(names, values) if "time" in quantities else ()
    if isinstance(time, ClockRequest):
        return time
    if time:
        columns["time"] = time
        by_unit = "" if clock_of(time[0]) else ", because it has a unit of time and increases"
        reasons.append(f"time is {' and '.join(time)}{by_unit}")
    chosen = _chosen(usable, quantities, len(wanted), len(labels), channels)
    if isinstance(chosen, ClockRequest):
        return chosen
    order = _order(chosen, () if in_file_order else labels)
    for quantity, group in chosen.items():
        columns[quantity] = tuple(group.members[channel].column for channel in order)
        reasons.append(_reason(quantity, group, columns[quantity], usable))
    commands = _commands(usable, chosen.get("q"), order, channels, values) if "command" in quantities else []
    commands = _best(commands, len(wanted), len(labels))
    if len(commands) == 1:
        of_channels = order or _order({"command": commands[0]}, () if in_file_order else labels)
        columns["command"] = tuple(commands[0].members[channel].column for channel in of_channels)
        reasons.append(_reason("command", commands[0], columns["command"], usable))
    undecided = tuple(group.columns for group in commands) if len(commands) > 1 else ()
    of_names = tuple(str(channel) for channel in order) if any(g.by_name for g in chosen.values()) else ()
    asked = tuple(quantity for quantity, group in chosen.items() if group.first.commanded)
    return Guess(columns, of_names, tuple(reasons), asked, undecided)


def _chosen(
    usable: Sequence[_Group], quantities: Sequence[str], joints: int, described: int, channels: int
) -> dict[str, _Group] | ClockRequest:
    """Chooses the best group of columns for each quantity.

    If a quantity has several best groups, the ambiguous guesses are returned instead.
    """
    chosen: dict[str, _Group] = {}
    requests: list[ClockRequest] = []
    for quantity in ("q", "dq", "ddq", "effort"):
        if quantity not in quantities:
            continue
        fitting = [
            group for group in usable if group.quantity == quantity and _goes_with(group, chosen.get("q"), channels)
        ]
        best = _best(fitting, joints, described)
        if len(best) > 1:
            requests.append(ClockRequest(quantity, tuple(group.columns for group in best)))
        elif best:
            chosen[quantity] = best[0]
        elif quantity == "q":
            break
    return replace(requests[0], others=tuple(requests[1:])) if requests else chosen


def _commands(
    usable: Sequence[_Group],
    positions: _Group | None,
    order: Sequence[Channel],
    channels: int,
    values: Values | None,
) -> list[_Group]:
    """Groups of commanded positions beside measured positions, those whose names state the quantity preferred.

    Args:
        usable: All groups.
        positions: Chosen group of positions; `None` if the positions were not guessed.
        order: Channels of the quantities chosen so far, all of which a command must have.
        channels: Number of columns of positions, if they were not guessed; 0 if they are unknown.
        values: Function that returns the numbers of a column.
    """
    if (positions is None and not channels) or (positions is not None and positions.first.commanded):
        return []
    found = [
        group
        for group in usable
        if (group.quantity == "command" or (group.quantity == "q" and group.first.commanded))
        and _same_channels(group, positions, channels)
        and set(order) <= set(group.members)
        and (values is None or are_numbers(group.columns, values))
    ]
    return [group for group in found if group.quantity == "q"] or found


def _groups(names: Sequence[str], labels: Sequence[str], *, matrices: bool) -> list[_Group]:
    """Groups of columns with the same quantity and the same words in the name, with one column for each channel."""
    found: dict[_Form, dict[Channel, ColumnName]] = {}
    for column in dict.fromkeys(names):
        for each in named(column, labels):
            if each.channel == "" and not matrices:
                continue
            copy = 0
            while True:
                members = found.setdefault((each.quantity, each.form, isinstance(each.channel, int), copy), {})
                if each.channel not in members:
                    break
                copy += 1
            members[each.channel] = each
    return [
        _Group("effort" if quantity == "current" else quantity, quantity == "current", _in_order(members))
        for (quantity, *_), members in _without_indices(found).items()
    ]


def _without_indices(found: Mapping[_Form, dict[Channel, ColumnName]]) -> dict[_Form, dict[Channel, ColumnName]]:
    """Joins groups of columns that differ only in an index beside the names of different joints.

    In this case the name of the joint is used, and the index is ignored: `wrist_1_joint_4_pos` is a position of
    `wrist_1_joint`. Groups with columns of the same joint are not joined, because their indices distinguish two
    sensors of this joint.
    """
    alike: dict[_Form, list[_Form]] = {}
    for key in found:
        quantity, form, by_number, copy = key
        plain = form if by_number else tuple("#" if word.isdigit() else word for word in form)
        alike.setdefault((quantity, plain, by_number, copy), []).append(key)
    joined: dict[_Form, dict[Channel, ColumnName]] = {}
    for plain, keys in alike.items():
        channels = [channel for key in keys for channel in found[key]]
        if len(keys) > 1 and len(set(channels)) == len(channels):
            joined[plain] = {channel: each for key in keys for channel, each in found[key].items()}
        else:
            joined |= {key: found[key] for key in keys}
    return joined


def _in_order(members: Mapping[Channel, ColumnName]) -> dict[Channel, ColumnName]:
    numbered = {channel: each for channel, each in members.items() if isinstance(channel, int)}
    return dict(sorted(numbered.items())) if len(numbered) == len(members) else dict(members)


def _is_whole(group: _Group, wanted: Sequence[str], *, matrices: bool) -> bool:
    """Checks whether a group has a column for each joint, or channel numbers from 0 or 1 without a gap."""
    if group.by_name:
        return bool(wanted) and set(wanted) <= set(group.members)
    if "" in group.members:
        return matrices
    numbers = [int(channel) for channel in group.members]
    several = len(numbers) > 1 or len(wanted) == 1
    return several and numbers in (list(range(len(numbers))), list(range(1, len(numbers) + 1)))


def _goes_with(group: _Group, positions: _Group | None, channels: int) -> bool:
    """Checks whether a group of columns fits the group of the positions.

    It fits if it has the same kind of channels and, for velocities and accelerations, if both groups are measured or
    both are commanded.
    """
    alike = positions is None or group.first.commanded == positions.first.commanded
    return _same_channels(group, positions, channels) and (group.quantity not in MOTION or alike)


def _same_channels(group: _Group, positions: _Group | None, channels: int) -> bool:
    """Checks whether a group of columns has the same kind of channels as the positions."""
    if positions is None:
        return not channels or "" in group.members or (not group.by_name and len(group.members) == channels)
    return group.by_name if positions.by_name else set(group.members) == set(positions.members)


def _best(groups: Sequence[_Group], joints: int, described: int) -> list[_Group]:
    """Groups of columns that fit the joints of the arm best; several groups if they fit equally well."""

    def key(group: _Group) -> tuple[bool, bool, int, bool, int]:
        role, motor = group.first.rank
        odd = (
            not group.by_name
            and bool(joints)
            and len(group.members) not in (joints, described)
            and "" not in group.members
        )
        return not group.by_name, odd, role, group.of_current, motor

    first = min((key(group) for group in groups), default=None)
    return [group for group in groups if key(group) == first]


def _order(chosen: Mapping[str, _Group], labels: Sequence[str]) -> list[Channel]:
    """Channels that all quantities have, in the order of their numbers, of `labels`, or of the file."""
    if not chosen:
        return []
    first, *others = chosen.values()
    common = [channel for channel in first.members if all(channel in other.members for other in others)]
    return [label for label in labels if label in common] if first.by_name and labels else common


def _reason(quantity: str, group: _Group, columns: tuple[str, ...], usable: Sequence[_Group]) -> str:
    """Text that names the chosen columns of a quantity, the reason for the choice, and the other possible columns."""
    what = f"{quantity} is {shortened(columns)}"
    what += ", from the names of the joints" if group.by_name else ""
    what += ", commanded and not measured" if group.first.commanded and quantity != "command" else ""
    others = [other for other in usable if other.quantity == group.quantity and other is not group]
    others = [other for other in others if quantity != "command" or other.first.commanded]
    left = [f"{shortened(other.columns)}{' (commanded)' if other.first.commanded else ''}" for other in others]
    return what + (f", not {', '.join(left)}" if left else "")


def are_numbers(columns: Sequence[str], values: Values) -> bool:
    """Checks whether all columns consist of numbers."""
    try:
        return all(values(name).dtype.kind in "fiu" for name in columns)
    except RecordingError:
        return False


def shortened(columns: Sequence[str]) -> str:
    """Text that names several columns; of four or more columns, only the first and the last are named."""
    return ", ".join(columns) if len(columns) < 4 else f"{columns[0]} … {columns[-1]}"
