"""Values: checked read-only arrays, saving and loading, files written whole or not at all.

A value is a frozen dataclass whose fields are numbers, strings, arrays, other values, or tuples and dicts of
these. `save` writes any of them to one file (a NumPy archive with a JSON header, never a pickle), `load` reads it.
All writers of armid use `replace_file`.
"""

from __future__ import annotations

import dataclasses
import hashlib
import io
import json
import os
import tempfile
import types
import typing
import zipfile
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from armid.errors import ArmidError, OutputError
from armid.stored_as_text import TextValue

Array = NDArray[np.float64]
T = TypeVar("T")


def array(value: ArrayLike, shape: tuple[int | None, ...], name: str, *, finite: bool = True) -> Array:
    """Read-only float64 copy of `value`, with its shape and finiteness checked.

    Args:
        value: Anything NumPy reads as numbers.
        shape: Expected length of each axis; `None` accepts any.
        name: Name of the array in messages.
        finite: Whether to refuse NaN and infinity.

    Raises:
        ArmidError: The value is not numeric, has another shape, or is not finite.
    """
    try:
        result = np.array(value, dtype=np.float64, order="C", copy=True)
    except (TypeError, ValueError) as error:
        raise ArmidError(f"{name} must be an array of numbers; found {value!r:.80}.") from error
    if result.ndim != len(shape) or any(
        want is not None and want != have for want, have in zip(shape, result.shape, strict=True)
    ):
        wanted = "(" + ", ".join("any" if n is None else str(n) for n in shape) + ")"
        raise ArmidError(f"{name} must have shape {wanted}; found {result.shape}.")
    if finite and not np.isfinite(result).all():
        first = tuple(int(i) for i in np.argwhere(~np.isfinite(result))[0])
        raise ArmidError(f"{name} must be finite; found {result[first]} at index {first}.")
    result.setflags(write=False)
    return result


def replace_file(path: Path | str, content: bytes | str) -> Path:
    """Writes `content` to `path` whole or not at all, through a temporary file in the same folder.

    Raises:
        OutputError: The folder cannot be made or written, or the disk is full; nothing is left behind.
    """
    path = Path(path)
    data = content.encode() if isinstance(content, str) else content
    temporary: str | None = None
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        handle, temporary = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.")
        with os.fdopen(handle, "wb") as stream:
            stream.write(data)
            stream.flush()
            os.fsync(stream.fileno())
        mask = os.umask(0)
        os.umask(mask)
        os.chmod(temporary, 0o666 & ~mask)
        os.replace(temporary, path)
        temporary = None
    except OSError as error:
        raise OutputError(
            f"{path} could not be written: {error.strerror or error}.",
            remedy="choose a folder that exists, is writable and has room.",
        ) from error
    finally:
        if temporary is not None:
            Path(temporary).unlink(missing_ok=True)
    return path


def sha256_of_file(path: Path | str) -> str:
    """Hexadecimal sha256 of a file's bytes."""
    with open(path, "rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def digest(*parts: ArrayLike | str) -> str:
    """Hexadecimal sha256 over arrays and strings, which identifies the inputs of a value."""
    state = hashlib.sha256()
    for part in parts:
        state.update(part.encode() if isinstance(part, str) else np.ascontiguousarray(part).tobytes())
        state.update(b"\0")
    return state.hexdigest()


def save(value: Any, path: Path | str) -> Path:
    """Saves a value to one file: an uncompressed `.npz` whose member `value.json` describes the rest.

    Args:
        value: A frozen dataclass of armid.
        path: Path of the file, written whole or not at all.
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
        ArmidError: The file is not one of armid's, or holds another type.
    """
    try:
        with open(path, "rb") as stream, np.load(stream, allow_pickle=False) as archive:
            header = json.loads(bytes(archive["value.json"]))
            arrays = {name: archive[name] for name in archive.files}
    except (OSError, EOFError, ValueError, KeyError, TypeError, zipfile.BadZipFile) as error:
        raise ArmidError(
            f"{path} is not a value saved by armid ({error}).", remedy="give a file that armid.values.save wrote."
        ) from error
    if header["type"] != kind.__name__:
        raise ArmidError(
            f"{path} holds a {header['type']}; a {kind.__name__} was asked for.",
            remedy="give the file that holds it.",
        )
    return _unpack(kind, header["value"], arrays)


def _pack(value: Any, arrays: dict[str, NDArray[Any]]) -> Any:
    """JSON form of a value; arrays move to `arrays` and leave `{"array": name}` behind."""
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
    """Name of a field in a file, which stays when the field is renamed."""
    return field.metadata.get("stored", field.name)


def _unpack(kind: Any, value: Any, arrays: dict[str, NDArray[Any]]) -> Any:
    """The value of type `kind` from its JSON form."""
    origin, arguments = typing.get_origin(kind), typing.get_args(kind)
    if isinstance(value, dict) and set(typing.cast("dict[str, Any]", value)) == {"array"}:
        return arrays[value["array"]]
    if origin in (typing.Union, types.UnionType):
        if value is None:
            return None
        return _unpack(next(a for a in arguments if a is not type(None)), value, arrays)
    if isinstance(kind, type) and issubclass(kind, TextValue):
        return kind.read(str(value))
    if dataclasses.is_dataclass(kind):
        hints = typing.get_type_hints(kind)
        fields = {_stored(f): f.name for f in dataclasses.fields(kind)}
        return typing.cast("Any", kind)(**{fields[k]: _unpack(hints[fields[k]], v, arrays) for k, v in value.items()})
    if origin is tuple:
        kinds = arguments[:1] * len(value) if arguments[-1] is Ellipsis else arguments
        return tuple(_unpack(k, v, arrays) for k, v in zip(kinds, value, strict=True))
    if origin is dict:
        return {key: _unpack(arguments[1], item, arrays) for key, item in value.items()}
    return value
