"""Reader of text tables with column names and one line per sample, also compressed (gzip, xz, bzip2 or zstd)."""

from __future__ import annotations

import bz2
import gzip
import lzma
import zlib
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

from armid.checked_array import Array
from armid.errors import MissingExtraError, RecordingError
from armid.input_boundary import most_unpacked, within_unpacked
from armid.measurement.catalogue import RecordingPieces
from armid.measurement.columns.column_selection import Selection, assemble, select
from armid.measurement.log_format import LogFormat
from armid.measurement.recording import Recording
from armid.measurement.text_table import TextTable, decoded, lists_of, numbers_of, rows_of, seconds_of, table_of
from armid.robot.robot import Robot

EXTRA = "io"

COMPRESSED = (".gz", ".xz", ".bz2", ".zst")
"""Suffixes of compressed files, which are always read as a whole."""

LONG = 64_000_000
"""Size of a file above which it is read in pieces [bytes]."""

HEAD = 1_000_000
"""Size of the beginning of a long file from which its columns are chosen [bytes]."""


def read(path: Path, log_format: LogFormat, robot: Robot | None = None) -> Recording:
    """Reads a text table; encoding, delimiter and decimal sign are detected.

    Lines that begin with `#`, `%` or `//` may precede the table. The last of these lines may be the header, and a
    line of units may follow the header. Times may be numbers, dates in the format of ISO 8601, or times of day. An
    incomplete last row is left out, with the finding `row-incomplete`. A field may be a list with one number for each
    joint, `"[0.1, 0.2]"`.

    Raises:
        RecordingError: There is no header, a row has a wrong number of fields, or a field is not a number. The
            message names the line.
        MissingExtraError: The file is compressed by zstd, but pyarrow is not installed.
    """
    table = table_of(decoded(_unpacked(path), path), path)
    lists = lists_of(table)

    def values(name: str) -> Array:
        dates = None if name in lists else seconds_of(table, name, path)
        return numbers_of(table, [name], path)[name] if dates is None else dates

    selection = select(table.names, log_format, path, robot, matrices=bool(lists), values=values)
    dates = seconds_of(table, selection.time[0], path) if len(selection.time) == 1 else None
    if dates is not None and (log_format.time_unit or selection.guessed.get("time_unit", 1.0)) != 1.0:
        raise RecordingError(
            f"{path}: the key `time_unit` is given, but the time column {selection.time[0]} contains dates.",
            remedy="leave the key `time_unit` out.",
        )
    wanted = [name for name in selection.names if dates is None or name != selection.time[0]]
    columns = numbers_of(table, wanted, path)
    if dates is not None:
        columns[selection.time[0]] = dates
    recording = assemble(selection, columns.__getitem__, log_format, path)
    return replace(recording, findings=(*table.findings, *recording.findings))


def pieces(path: Path, log_format: LogFormat, robot: Robot | None, length: int) -> RecordingPieces | None:
    """Pieces of a long table; `None` if it is short or compressed, has lists or dates, or is not in UTF-8.

    The number of samples is estimated from the first lines.

    Raises:
        RecordingError: As for `read`.
    """
    if path.suffix.lower() in COMPRESSED or path.stat().st_size < LONG:
        return None
    with path.open("rb") as file:
        first = file.read(HEAD)
    try:
        text = first[: first.rindex(b"\n") + 1].decode("utf-8-sig")
    except ValueError:  # no line ends, or the text is not UTF-8
        return None
    table = table_of(text, path)
    selection = select(
        table.names, log_format, path, robot, values=lambda name: numbers_of(table, [name], path)[name]
    )
    plain = '"' not in text and not lists_of(table) and len(selection.time) < 2
    if not plain or any(seconds_of(table, name, path) is not None for name in selection.time):
        return None
    line = len(text.encode()) / (len(table.rows) + table.numbers[0])
    return RecordingPieces(
        round(path.stat().st_size / line), _blocks(path, table, selection, log_format, round(length * line))
    )


def _blocks(
    path: Path, head: TextTable, selection: Selection, log_format: LogFormat, size: int
) -> Iterator[Recording]:
    """Yields the recording in blocks of whole lines, each of about `size` bytes."""
    with path.open("rb") as file:
        lines, held = 0, b""
        while block := file.read(size):
            end = held.rfind(b"\n") + 1  # an incomplete last line is judged with the lines before it
            if end:
                yield from _rows(path, head, selection, log_format, held[:end], lines)
                lines += held.count(b"\n")
            held = held[end:] + block
        if held.strip():
            yield from _rows(path, head, selection, log_format, held, lines)


def _rows(
    path: Path, head: TextTable, selection: Selection, log_format: LogFormat, block: bytes, lines: int
) -> Iterator[Recording]:
    """Yields the recording of some whole lines of a table, before which there are `lines` other lines."""
    table = rows_of(decoded(block, path), head, lines, path)
    if table.rows:
        columns = numbers_of(table, list(selection.names), path)
        recording = assemble(selection, columns.__getitem__, log_format, path)
        yield replace(recording, findings=(*table.findings, *recording.findings))


def _unpacked(path: Path) -> bytes:
    """Reads a file as bytes and decompresses them if the suffix is that of a compressed file."""
    openers = {".gz": gzip.open, ".xz": lzma.open, ".bz2": bz2.open, ".zst": _open_zstd}
    opener = openers.get(path.suffix.lower())
    if opener is None:
        return path.read_bytes()
    most = most_unpacked(path)
    try:
        with opener(path) as stream:
            data = stream.read(most + 1)
    except (OSError, EOFError, ValueError, zlib.error, lzma.LZMAError) as error:
        raise RecordingError(
            f"{path} cannot be unpacked ({error}).", remedy="copy the file again, because its end may be missing."
        ) from error
    within_unpacked(len(data), path, RecordingError)
    return data


def _open_zstd(path: Path) -> Any:
    try:
        import pyarrow as pa
    except ImportError as error:
        raise MissingExtraError("pyarrow", "Unpacking zstd", EXTRA) from error
    return pa.CompressedInputStream(pa.OSFile(str(path)), "zstd")
