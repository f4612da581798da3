"""Damage to folders of results: one of their files, and also the digests that protect their archives."""

from __future__ import annotations

import hashlib
import json
import zipfile
from pathlib import Path

import numpy as np
from array_mutators import damage_arrays
from byte_mutators import damage_bytes
from folder_mutators import Damage, write_anew
from numpy.random import Generator
from tree_mutators import damage_json


def npz_declared(path: Path, rng: Generator) -> None:
    """Damages the header of an array in an archive, which declares shape and type."""
    with zipfile.ZipFile(path) as archive:
        members = {each: archive.read(each) for each in archive.namelist()}
    member = list(members)[int(rng.integers(len(members)))]
    text = members[member]
    shapes = (b"(800000000000,)", b"(-1,)", b"(10,)", b"()", b"(0,)", b"(2, 400)", b"(1e3,)", b"'x'", b"(" * 300)
    types = (b"'|O'", b"'<f4'", b"'<U9'", b"'V'", b"'<c16'", b"None", b"[('a','<f8')]", b"'<i8'", b"'M8[s]'")
    choice = shapes[int(rng.integers(len(shapes)))] if rng.integers(2) else types[int(rng.integers(len(types)))]
    old = text[text.find(b"(") : text.find(b")") + 1] if choice in shapes else b"'<f8'"
    members[member] = text.replace(old, choice.ljust(len(old)), 1)
    path.unlink()
    with zipfile.ZipFile(path, "w", [zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED][int(rng.integers(2))]) as archive:
        for each, data in members.items():
            archive.writestr(each, data)


def archive_values(path: Path, rng: Generator) -> None:
    """Damages the JSON header or an array of a value that armid saved."""
    with np.load(path) as archive:
        arrays = {each: archive[each] for each in archive.files}
    if rng.integers(3):
        text = damage_json(bytes(arrays["value.json"]).decode(), rng)
        arrays["value.json"] = np.frombuffer(text or b" ", dtype=np.uint8)
    else:
        others = {
            each: values for each, values in arrays.items() if each != "value.json" and values.ndim and values.size
        }
        damaged = damage_arrays(others, rng) if others else {}
        arrays = {"value.json": arrays["value.json"], **damaged}
    path.unlink()
    np.savez(path, **arrays)  # pyright: ignore[reportArgumentType]


def damage_stored(path: Path, rng: Generator) -> None:
    """Damages one file of a folder of results: lost, or damaged in its bytes, its record or its arrays."""
    kind = rng.integers(8)
    if kind == 0:
        path.unlink()
    elif path.suffix == ".json" and kind > 1:
        write_anew(path, damage_json(path.read_text(), rng))
    elif path.suffix == ".npz" and kind > 1:
        (npz_declared if kind == 2 else archive_values)(path, rng)
    else:
        write_anew(path, damage_bytes(path.read_bytes(), rng))


def of_stored(name: str, record: str, *read: str) -> Damage:
    """Damage to one of the files that are read of a folder of results.

    Args:
        name: Folder among the clean inputs.
        record: File that contains the digests of the archives.
        read: The files; the first ones are damaged more often.
    """
    names = (record, *read)
    weights = 1.0 / (1.0 + 0.5 * np.arange(len(names)))

    def damage(folder: Path, rng: Generator) -> None:
        damage_stored(folder / name / str(rng.choice(names, p=weights / weights.sum())), rng)

    return damage


def with_new_digests(name: str, record: str, *archives: str) -> Damage:
    """Damage to an archive of a folder of results, and digests that fit, as an attacker writes them.

    Args:
        name: Folder among the clean inputs.
        record: File that contains the digests of the archives.
        archives: The archives.
    """

    def damage(folder: Path, rng: Generator) -> None:
        place = folder / name
        path = place / str(rng.choice(archives))
        (archive_values if rng.integers(4) else npz_declared)(path, rng)
        kept = json.loads((place / record).read_text())
        kept["sha256"][path.name] = hashlib.sha256(path.read_bytes()).hexdigest()
        write_anew(place / record, json.dumps(kept).encode())

    return damage
