"""Search for missing columns in a set of numbered columns, and for the joints to which they would belong."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path

from armid.errors import RecordingError
from armid.measurement.columns.column_name_parsing import quantity_of, split_unit, words
from armid.measurement.log_format import LogFormat
from armid.measurement.remedy_builders import naming
from armid.remedy import Remedy
from armid.robot.robot import Robot


def joints_of_channels(count: int, log_format: LogFormat, robot: Robot | None) -> tuple[str, ...]:
    """Names of the joints to which numbered channels would be assigned; empty if they are unknown.

    Args:
        count: Number of channels.
        log_format: Log format of the file; if it assigns channels to joints, the result is empty.
        robot: The arm, if it is known.
    """
    if robot is None or log_format.joints:
        return ()
    return next((names for names in (robot.joint_names, robot.described_joints) if len(names) == count), ())


def absent_columns(columns: Sequence[str], positions: Sequence[str]) -> dict[int, str]:
    """Names of the columns that a quantity lacks in comparison with the positions, by index of the channel.

    Args:
        columns: Columns of a quantity, whose names differ only in one number.
        positions: Columns of positions, whose names also differ only in one number.

    Returns:
        Names of the missing columns. The result is empty if the columns are not numbered in the same way as the
        positions, or if their numbering is ambiguous: if positions are numbered from 0 and no column has the number
        0, the columns may be numbered from 1.
    """
    own, every = _numbers(columns), _numbers(positions)
    if own is None or every is None or not set(own[2]) < set(every[2]) or _may_start_at_1(own[2], every[2]):
        return {}
    before, after, present = own
    return {k: f"{before}{number}{after}" for k, number in enumerate(every[2]) if number not in present}


def incomplete_effort(unread: Sequence[str], positions: Sequence[str]) -> tuple[tuple[str, ...], dict[int, str]]:
    """Largest incomplete set of numbered columns whose names indicate effort, and the columns missing from it.

    The missing columns are given by index of the channel.

    Args:
        unread: Columns that were not read.
        positions: Columns of positions.
    """
    sets: dict[tuple[str, str], list[str]] = {}
    for name in unread:
        if quantity_of(words(split_unit(name)[0])) in ("effort", "current"):
            for number in re.finditer(r"\d+", name):
                sets.setdefault((name[: number.start()], name[number.end() :]), []).append(name)
    found = {tuple(each): absent for each in sets.values() if (absent := absent_columns(each, positions))}
    return max(found.items(), key=lambda each: len(each[0]), default=((), {}))


def uneven_channels(
    chosen: Mapping[str, tuple[str, ...]],
    q: int,
    effort: int,
    path: Path,
    log_format: LogFormat,
    joints: Sequence[str] = (),
) -> RecordingError:
    """Error for positions and effort with different numbers of channels.

    Args:
        chosen: Names of the columns of each quantity.
        q: Number of channels of positions.
        effort: Number of channels of effort.
        path: The file.
        log_format: Log format of the file.
        joints: Names of the joints of the channels; empty if they are unknown.
    """
    listed = [
        f"{count} columns of {name} ({' … '.join(dict.fromkeys((*chosen[name][:1], *chosen[name][-1:])))})"
        for name, count in (("q", q), ("effort", effort))
    ]
    fewer = "effort" if effort < q else "q"
    absent = absent_columns(chosen["effort"], chosen["q"]) if fewer == "effort" else {}
    missing = with_joints(absent, joints) if absent else str(abs(q - effort))
    remedy: str = (
        f"add the missing columns of {fewer}; or name the same number of columns for both quantities in `columns`, "
        "and lock the joints that were not recorded."
    )
    return RecordingError(
        f"{path} has {listed[0]}, but {listed[1]} (missing columns of {fewer}: {missing}).",
        remedy=remedy_of(absent, chosen["effort"], chosen, joints, log_format) if absent else remedy,
    )


def with_joints(absent: Mapping[int, str], joints: Sequence[str]) -> str:
    """Text that lists missing columns, each followed by its joint if this is known: `tau3 (elbow)`."""
    return ", ".join(f"{name} ({joints[k]})" if k < len(joints) else name for k, name in absent.items())


def remedy_of(
    absent: Mapping[int, str],
    effort: Sequence[str],
    chosen: Mapping[str, Sequence[str]],
    joints: Sequence[str],
    log_format: LogFormat,
) -> Remedy:
    """Remedy for missing columns of effort: log them, or lock their joints and leave out the columns of these joints.

    Args:
        absent: Missing columns by index of the channel.
        effort: Columns of effort that the file has.
        chosen: Names of the columns of each quantity.
        joints: Names of the joints of the channels; empty if they are unknown.
        log_format: Log format of the file.
    """
    names = [joints[k] if k < len(joints) else f"the joint of {name}" for k, name in absent.items()]
    locks = f" ({' '.join(f'--lock {joints[k]}=VALUE' for k in absent)}, or lock in [robot])" if joints else ""
    kept = {
        key: [name for k, name in enumerate(columns) if k not in absent]
        for key, columns in chosen.items()
        if key in ("q", "dq", "ddq") and len(columns) == len(chosen["q"])
    }
    still = f"{' and '.join(names)} stood still, lock {'it' if len(names) == 1 else 'them'}{locks}"
    return Remedy(
        f"log {', '.join(absent.values())}, too; or, if {still}, and leave out the other columns of such joints: ",
        *naming(log_format, {**kept, "effort": list(effort)}).parts,
    )


def _may_start_at_1(numbers: Sequence[int], positions: Sequence[int]) -> bool:
    """Checks whether columns may be numbered from 1 although the columns of positions are numbered from 0."""
    return 0 in positions and 0 not in numbers and {number - 1 for number in numbers} <= set(positions)


def _numbers(columns: Sequence[str]) -> tuple[str, str, list[int]] | None:
    """Text before and after the single number in which the names differ, and the numbers of all names.

    The result is `None` if the names differ in more than one number, or if there are fewer than two names.
    """
    for number in re.finditer(r"\d+", columns[0]) if columns else ():
        before, after = columns[0][: number.start()], columns[0][number.end() :]
        form = re.compile(re.escape(before) + r"(\d+)" + re.escape(after))
        found = [hit for name in columns if (hit := form.fullmatch(name))]
        if len(found) == len(columns) > 1:
            return before, after, [int(hit[1]) for hit in found]
    return None
