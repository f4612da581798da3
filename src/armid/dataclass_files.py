"""Saving of values to files, and loading of saved values.

A value is a frozen dataclass whose fields are numbers, strings, arrays, other values, or tuples and dicts of these.
`save` writes a value to one file (a NumPy archive with a JSON header, never a pickle), and `load` reads it.
"""

from __future__ import annotations

import dataclasses
import io
import json
import math
import types
import typing
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from armid.atomic_file import replace_file
from armid.errors import ArmidError
from armid.input_boundary import MadeError, boundary, within_unpacked
from armid.text_stored_value import TextValue

T = TypeVar("T")


def save(value: Any, path: Path | str) -> Path:
    """Saves a value to one file: an uncompressed `.npz` whose member `value.json` describes the other members.

    Args:
        value: A frozen dataclass of armid.
        path: Path of the file, which is written completely or not at all.
    """
    arrays: dict[str, NDArray[Any]] = {}
    header = {"type": type(value).__name__, "value": _pack(value, arrays)}
    buffer = io.BytesIO()
    text = np.frombuffer(json.dumps(header, allow_nan=True).encode(), dtype=np.uint8)
    np.savez(buffer, **{"value.json": text}, **arrays)  # pyright: ignore[reportArgumentType]
    return replace_file(path, buffer.getvalue())


def load(kind: type[T], path: Path | str) -> T:
    """Loads a value saved by `save`.

    Raises:
        ArmidError: The file was not written by `save`, or contains a value of another type.
    """
    with boundary("a value saved by armid", path, remedy="give a file that armid.dataclass_files.save wrote."):
        with open(path, "rb") as stream, np.load(stream, allow_pickle=False) as archive:
            refuse_large_archive(archive, path)
            header = json.loads(bytes(archive["value.json"]))
            arrays = {name: archive[name] for name in archive.files}
        found, value = header["type"], header["value"]
    if found != kind.__name__:
        raise ArmidError(
            f"{path} contains a value of type {found}, but a {kind.__name__} is needed.",
            remedy=f"give a file that contains a {kind.__name__}.",
        )
    what = f"a {kind.__name__} of this version of armid"
    remedy = "make the file again; it is damaged, or another version of armid wrote it."
    with boundary(what, path, remedy=remedy):
        try:
            return _unpack(kind, value, arrays)
        except ArmidError as fault:  # a value refuses what it is made of, but does not know the file
            raise ArmidError(f"{path} cannot be read as {what}: {fault.problem}", remedy=remedy) from fault


def refuse_large_archive(archive: np.lib.npyio.NpzFile, path: Path | str, error: MadeError = ArmidError) -> None:
    """Raises an error if the arrays of a NumPy archive are much larger than the file.

    Args:
        archive: The archive, from which nothing has been read yet.
        path: The file.
        error: Class of the error.
    """
    zipped: Any = archive.zip
    for name in archive.files:
        with zipped.open(name if name in zipped.namelist() else f"{name}.npy") as member:
            major = np.lib.format.read_magic(member)[0]
            read = np.lib.format.read_array_header_1_0 if major == 1 else np.lib.format.read_array_header_2_0
            shape, _, dtype = read(member)
            within_unpacked(math.prod(map(float, shape)) * dtype.itemsize, path, error)
    within_unpacked(sum(member.file_size for member in zipped.infolist()), path, error)


def _pack(value: Any, arrays: dict[str, NDArray[Any]]) -> Any:
    """JSON form of a value, with `{"array": name}` for each array; the arrays are added to `arrays`."""
    if isinstance(value, np.ndarray):
        name = f"array_{len(arrays)}"
        arrays[name] = value
        return {"array": name}
    if isinstance(value, TextValue):
        return str(value)
    if dataclasses.is_dataclass(value):
        return {_stored(f): _pack(getattr(value, f.name), arrays) for f in dataclasses.fields(value) if f.init}
    if isinstance(value, tuple | list):
        return [_pack(item, arrays) for item in typing.cast("tuple[Any, ...]", value)]
    if isinstance(value, dict):
        return {str(key): _pack(item, arrays) for key, item in typing.cast("dict[Any, Any]", value).items()}
    if isinstance(value, np.generic):
        return value.item()
    return value


def _stored(field: dataclasses.Field[Any]) -> str:
    """Name of a field in a file, which does not change if the field is renamed."""
    return field.metadata.get("stored", field.name)


def _unpack(kind: Any, value: Any, arrays: dict[str, NDArray[Any]]) -> Any:
    """Value of type `kind` from its JSON form and the arrays.

    Raises:
        TypeError: The JSON form has another type.
    """
    origin, arguments = typing.get_origin(kind), typing.get_args(kind)
    if isinstance(value, dict) and set(typing.cast("dict[str, Any]", value)) == {"array"}:
        return _numbers(arrays[value["array"]])
    if origin in (typing.Union, types.UnionType):
        return _alternative(arguments, value, arrays)
    if isinstance(kind, type) and issubclass(kind, TextValue):
        return kind.read(str(value))
    if dataclasses.is_dataclass(kind):
        hints = typing.get_type_hints(kind)
        fields = {_stored(f): f.name for f in dataclasses.fields(kind)}
        return typing.cast("Any", kind)(**{fields[k]: _unpack(hints[fields[k]], v, arrays) for k, v in value.items()})
    if origin is tuple:
        kinds = arguments[:1] * len(value) if arguments[-1] is Ellipsis else arguments
        return tuple(_unpack(k, v, arrays) for k, v in zip(kinds, value, strict=True))
    if origin in (dict, Mapping):
        return {key: _unpack(arguments[1], item, arrays) for key, item in value.items()}
    if origin is Sequence and not isinstance(value, list):
        raise TypeError(f"{str(value)[:40]!r} stands in place of a list")
    return _plain(kind, origin, value)


def _numbers(array: NDArray[Any]) -> NDArray[Any]:
    """An array, after a check that it contains numbers, truth values or texts, the only contents that are saved.

    Raises:
        TypeError: The array contains something else, such as dates or records.
    """
    if array.dtype.kind not in "biufU":
        raise TypeError(f"an array of the type {array.dtype} stands in place of numbers")
    return array


def _alternative(kinds: tuple[Any, ...], value: Any, arrays: dict[str, NDArray[Any]]) -> Any:
    """Value of the first of several types that fits its JSON form."""
    if value is None and type(None) in kinds:
        return None
    faults: list[Exception] = []
    for kind in kinds:
        if kind is not type(None):
            try:
                return _unpack(kind, value, arrays)
            except (TypeError, ValueError, KeyError, AttributeError) as fault:
                faults.append(fault)
    raise faults[0]


def _plain(kind: Any, origin: Any, value: Any) -> Any:
    """Number, text or other value without parts, after a check of its type."""
    if origin is np.ndarray:
        raise TypeError(f"{str(value)[:40]!r} stands in place of an array")
    if kind in (bool, int, float, str):
        is_number = isinstance(value, int | float) and not isinstance(value, bool)
        if not (is_number if kind is float else type(value) is kind):
            raise TypeError(f"{str(value)[:40]!r} stands in place of a value of type {kind.__name__}")
    return value
