"""Boundary for files from outside: limits of sizes, and one kind of error for every failure of a library.

Readers call `within` before they allocate what a file asks for, and run libraries inside `boundary`. So a damaged or
hostile file ends in an `ArmidError` that names the file, never in an exception of a library.
"""

from __future__ import annotations

import json
import os
import tomllib
from collections.abc import Generator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any, Protocol

from armid.errors import ArmidError, did_you_mean

VARIABLE = "ARMID_ALLOW"
"""Environment variable with limits that are raised, such as `samples=1e9,links=20000`."""

LONGEST_REASON = 200
"""Number of characters of a library's message that are repeated in an error."""

NOT_REGULAR = "it is not a regular file"


@dataclass(frozen=True, slots=True)
class SizeLimit:
    """Largest size that is accepted without being asked for.

    Attributes:
        most: Largest accepted number.
        unit: What the number counts.
    """

    most: float
    unit: str


LIMITS: Mapping[str, SizeLimit] = MappingProxyType(
    {
        "text": SizeLimit(64e6, "bytes of text"),
        "unpacked": SizeLimit(40.0, "times the size of the file after unpacking"),
        "samples": SizeLimit(50e6, "samples"),
        "resampled": SizeLimit(20.0, "samples on a uniform grid for each recorded sample"),
        "motion": SizeLimit(3e6, "samples of a planned motion"),
        "joints": SizeLimit(500, "joints"),
        "links": SizeLimit(5000, "links"),
        "nesting": SizeLimit(150, "levels of nested elements"),
        "outside": SizeLimit(0, "files outside of its folders"),
    }
)
"""Limits by name. In 1600 published descriptions, a file has at most 220 joints, 214 links, 41 levels and 0.2 MB. An
hour of recording at 1 kHz has 3.6 million samples. On a uniform grid, a recording has at most a few times as many
samples as recorded, because longer steps count as gaps."""

ALWAYS_UNPACKED = 64e6
"""Number of bytes to which every file may unpack, because small files may be very regular."""

_allowed: ContextVar[Mapping[str, float]] = ContextVar("_allowed", default=MappingProxyType({}))


class MadeError(Protocol):
    """Class of the errors that a reader raises."""

    def __call__(self, problem: str, *, possible: str = "", remedy: str = "") -> ArmidError:
        """Makes an error."""
        ...


def allow(limits: Mapping[str, float]) -> None:
    """Replaces limits in this context.

    Args:
        limits: New limits by name, such as `{"samples": 1e9}`.

    Raises:
        ArmidError: A limit does not exist, or is not a positive number.
    """
    for name, most in limits.items():
        if name not in LIMITS:
            raise ArmidError(
                f"There is no limit {name!r}.", possible=", ".join(LIMITS), remedy=did_you_mean(name, LIMITS)
            )
        if not most > 0:
            raise ArmidError(f"The limit {name} must be above 0; found {most:g}.", remedy="give a positive number.")
    _allowed.set({**_allowed.get(), **limits})


def parsed_limits(text: str) -> dict[str, float]:
    """Limits by name, from a text such as `samples=1e9,links=20000`.

    Raises:
        ArmidError: The text has another form.
    """
    limits: dict[str, float] = {}
    for part in filter(None, text.split(",")):
        name, _, value = part.partition("=")
        try:
            limits[name.strip()] = float(value)
        except ValueError:
            raise ArmidError(
                f"{part!r} is not a limit.",
                possible=", ".join(LIMITS),
                remedy="write NAME=NUMBER, as in samples=1e9.",
            ) from None
    return limits


def limit(name: str) -> float:
    """Limit in force: given by `allow`, by the environment variable `ARMID_ALLOW`, or the default."""
    given = _allowed.get()
    return given[name] if name in given else parsed_limits(os.environ.get(VARIABLE, "")).get(name, LIMITS[name].most)


def within(name: str, found: float, where: str, error: MadeError = ArmidError) -> None:
    """Raises an error if a size exceeds its limit; to be called before memory for it is allocated.

    Args:
        name: Name of the limit, a key of `LIMITS`.
        found: Size.
        where: File, and place in it, for the message.
        error: Class of the error.
    """
    most = limit(name)
    if found <= most:
        return
    raise error(
        f"{where} has {found:.4g} {LIMITS[name].unit}; the limit is {most:.4g}.",
        remedy="correct the input; if it is right, raise the limit with the environment variable "
        f"{VARIABLE}={name}={found * 1.01:.3g} or the option armid --allow {name}={found * 1.01:.3g}.",
    )


def within_unpacked(size: float, path: Path | str, error: MadeError = ArmidError) -> None:
    """Raises an error if the content of a compressed file is much larger than the file.

    Args:
        size: Number of bytes after unpacking.
        path: The compressed file.
        error: Class of the error.
    """
    if size > ALWAYS_UNPACKED:
        within("unpacked", size / max(Path(path).stat().st_size, 1), str(path), error)


def most_unpacked(path: Path | str) -> int:
    """Largest number of bytes to which a file may unpack."""
    return int(max(ALWAYS_UNPACKED, limit("unpacked") * Path(path).stat().st_size))


def reason(fault: BaseException) -> str:
    """One short line about a failure, for the user."""
    if isinstance(fault, MemoryError):
        return "it asks for more memory than there is"
    if isinstance(fault, RecursionError):
        return "it is nested too deeply"
    text = " ".join(str(fault).split())
    if isinstance(fault, KeyError):
        return f"{text} is missing"[:LONGEST_REASON]
    if isinstance(fault, OSError) and fault.strerror:
        return fault.strerror
    return text[:LONGEST_REASON] or type(fault).__name__


def is_failure(fault: BaseException) -> bool:
    """Tests whether an exception is a failure of a library, and not an interruption or an error of armid.

    Libraries in Rust raise a PanicException, which is not derived from Exception.
    """
    return not isinstance(fault, ArmidError) and (
        isinstance(fault, Exception) or type(fault).__name__ == "PanicException"
    )


@contextmanager
def boundary(
    what: str, path: Path | str, error: MadeError = ArmidError, *, possible: str = "", remedy: str = ""
) -> Generator[None]:
    """Context in which every failure becomes an error that names the file; errors of armid are left as they are.

    Args:
        what: What the file should be, with its article, for instance `a study`.
        path: The file or folder.
        error: Class of the error.
        possible: What is accepted.
        remedy: What to do; by default to correct the file or to write it again.
    """
    try:
        yield
    except BaseException as fault:
        if not is_failure(fault):
            raise
        raise error(
            f"{path} cannot be read as {what} ({reason(fault)}).",
            possible=possible,
            remedy=remedy or "correct the file, or write it again.",
        ) from fault


@contextmanager
def naming(path: Path | str) -> Generator[None]:
    """Context in which an error of armid begins with the path of a file if it does not name the file.

    Args:
        path: The file whose values are checked.
    """
    try:
        yield
    except ArmidError as fault:
        if Path(path).name in fault.problem:
            raise
        kind: MadeError = type(fault)
        raise kind(f"{path}: {fault.problem}", possible=fault.possible, remedy=fault.remedy) from fault


def read_text(path: Path | str, what: str, error: MadeError = ArmidError, *, remedy: str = "") -> str:
    """Text of a file in UTF-8.

    Args:
        path: The file.
        what: What the file should be, with its article.
        error: Class of the error.
        remedy: What to do if the file cannot be read.
    """
    path = Path(path)
    with boundary(what, path, error, remedy=remedy):
        size = path.stat().st_size
        if not path.is_dir() and not path.is_file():
            raise OSError(NOT_REGULAR)  # a device or a pipe may never end
    within("text", size, str(path), error)
    with boundary(what, path, error, remedy=remedy):
        return path.read_text(encoding="utf-8")


def read_json(path: Path | str, what: str, error: MadeError = ArmidError, *, remedy: str = "") -> dict[str, Any]:
    """Object of a JSON file; the arguments are those of `read_text`."""
    text = read_text(path, what, error, remedy=remedy)
    with boundary(what, path, error, remedy=remedy):
        record: Any = json.loads(text)
        if not isinstance(record, dict):
            raise TypeError(f"it contains a {type(record).__name__}, not an object")
    within("nesting", _levels(record), str(path), error)
    return record


def _levels(record: Any) -> int:
    """Number of levels of nested lists and tables of a record."""
    levels, inside = 0, [record]
    while inside:
        levels += 1
        values = (each.values() if isinstance(each, dict) else each for each in inside)
        inside = [value for each in values for value in each if isinstance(value, dict | list)]
    return levels


def read_toml(path: Path | str, what: str, error: MadeError = ArmidError, *, remedy: str = "") -> dict[str, Any]:
    """Tables of a TOML file; the arguments are those of `read_text`."""
    return parse_toml(read_text(path, what, error, remedy=remedy), path, error)


def parse_toml(text: str, source: Path | str, error: MadeError = ArmidError) -> dict[str, Any]:
    """Tables of a TOML text; failures of the parser become one error.

    Args:
        text: The text.
        source: File, for the message.
        error: Class of the error.
    """
    try:
        tables = tomllib.loads(text)
    except Exception as fault:
        raise error(
            f"{source} is not valid TOML: {reason(fault)}.", remedy="correct the line that the message names."
        ) from fault
    within("nesting", _levels(tables), str(source), error)
    return tables
