"""Damage to folders of several files, and to the sizes that files declare before their content."""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
from array_mutators import damage_arrays
from byte_mutators import INTEGERS, damage_bytes, damage_text
from numpy.random import Generator
from tree_mutators import damage_json

Damage = Callable[[Path, Generator], None]

MCAP_MAGIC = b"\x89MCAP0\r\n"
CHUNK = 0x06


def write_anew(path: Path, data: bytes) -> None:
    """Writes a file anew; the clean file may be a hard link, so it is not overwritten."""
    path.unlink(missing_ok=True)
    path.write_bytes(data)


def of_folder(name: str, of_arrays: Callable[[Path, Generator], None] | None = None) -> Damage:
    """Damage to one of the files of a folder: lost, empty, a folder of its name, or damaged inside."""

    def damage(folder: Path, rng: Generator) -> None:
        files = sorted(path for path in (folder / name).rglob("*") if path.is_file())
        path = files[int(rng.integers(len(files)))]
        kind = int(rng.integers(12))
        if kind == 0:
            path.unlink()
        elif kind == 1:
            write_anew(path, b"")
        elif kind == 2:
            path.unlink()
            path.mkdir()
        elif kind == 3:
            write_anew(path.with_name(f"another{path.suffix}"), path.read_bytes())
        elif path.suffix in (".parquet", ".hdf5") and of_arrays is not None and kind > 5:
            of_arrays(path, rng)
        elif path.suffix == ".json":
            write_anew(path, damage_json(path.read_text(), rng))
        elif path.suffix == ".mcap" and kind > 6:
            declare(path, rng)
        elif path.suffix in (".csv", ".txt", ".yaml"):
            write_anew(path, damage_text(path.read_text(), rng).encode("utf-8", "replace"))
        else:
            write_anew(path, damage_bytes(path.read_bytes(), rng))

    return damage


def records_of(data: bytes) -> Iterator[tuple[int, int, int]]:
    """Type, place of the length and length of each record of an MCAP file."""
    at = len(MCAP_MAGIC)
    while at + 9 <= len(data) - len(MCAP_MAGIC):
        length = int.from_bytes(data[at + 1 : at + 9], "little")
        yield data[at], at + 1, length
        at += 9 + length


def declare(path: Path, rng: Generator) -> None:
    """Replaces a declared size in an MCAP file: of a record, of a chunk before compression, or of records in it."""
    data = bytearray(path.read_bytes())
    records = list(records_of(bytes(data)))
    chunks = [each for each in records if each[0] == CHUNK]
    size = int(INTEGERS[int(rng.integers(len(INTEGERS)))])
    if chunks and rng.integers(2):
        _, place, _ = chunks[int(rng.integers(len(chunks)))]
        inside = place + 8
        offset = (0, 8, 16, 24, 28)[int(rng.integers(5))]  # times, size, checksum, length of the compression's name
        width = 4 if offset in (24, 28) else 8
        data[inside + offset : inside + offset + width] = (size & (256**width - 1)).to_bytes(width, "little")
    else:
        _, place, _ = records[int(rng.integers(len(records)))]
        data[place : place + 8] = struct.pack("<Q", size & (2**64 - 1))
    write_anew(path, bytes(data))


def lists_of_parquet(path: Path, rng: Generator) -> None:
    """Damage to a column of a Parquet file whose fields are lists."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    columns = {name: values.to_pylist() for name, values in zip(*_columns(pq.read_table(path)), strict=True)}
    name = list(columns)[int(rng.integers(len(columns)))]
    kind, values = int(rng.integers(7)), columns[name]
    row = int(rng.integers(len(values)))
    if kind == 0:
        del columns[name]
    elif kind == 1:
        values[row] = None
    elif kind == 2 and isinstance(values[row], list):
        values[row] = values[row][:-1]
    elif kind == 3 and isinstance(values[row], list):
        values[row] = [float("nan")] * 3
    elif kind == 4:
        columns = {key: each[: int(rng.choice([0, 1, 5, 20]))] for key, each in columns.items()}
    elif kind == 5:
        columns[name] = [str(each) for each in values]
    else:
        plain = {"column": np.array([each[0] if isinstance(each, list) else each for each in values], dtype=float)}
        columns[name] = next(iter(damage_arrays(plain, rng).values()), np.zeros(0)).tolist()
    path.unlink()
    try:
        pq.write_table(pa.table(columns), path)
    except (pa.ArrowException, ValueError, TypeError):
        path.write_bytes(b"")  # the format cannot contain such columns


def _columns(table: object) -> tuple[list[str], list[object]]:
    return table.column_names, table.columns  # pyright: ignore


def arrays_of_hdf5(path: Path, rng: Generator) -> None:
    """Damage to a data set of an HDF5 file."""
    import h5py

    tables: dict[str, np.ndarray] = {}
    with h5py.File(path, "r") as file:
        file.visititems(lambda name, each: tables.update({name: each[()]}) if hasattr(each, "dtype") else None)
    damaged = damage_arrays(tables, rng)
    path.unlink()
    with h5py.File(path, "w") as file:
        for name, values in damaged.items():
            try:
                file[name] = values
            except TypeError:
                continue  # the format cannot contain such values


def of_file(name: str, *damages: Callable[[Path, Generator], None]) -> Damage:
    """Damage to one file by one of several functions, or to its bytes."""

    def damage(folder: Path, rng: Generator) -> None:
        path = folder / name
        kind = int(rng.integers(len(damages) + 1))
        if kind < len(damages):
            damages[kind](path, rng)
        else:
            write_anew(path, damage_bytes(path.read_bytes(), rng))

    return damage
