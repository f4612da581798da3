"""Mutators of tables of arrays: wrong types, shapes, lengths, names and values, for formats that store arrays."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

Arrays = dict[str, NDArray[Any]]

WILD = (np.nan, np.inf, -np.inf, 1e308, -1.0, 0.0, 1e6, 1e-300, 1e18)
"""Values that replace samples."""

KINDS = ("float32", "float16", "int64", "int8", "uint8", "bool", "complex128", "U5", "S3", "object", ">f8")
"""Types of arrays."""


def damage_arrays(arrays: Arrays, rng: Generator) -> Arrays:
    """Copy of a table in which one array, or the length of all, has a fault."""
    table = {name: values.copy() for name, values in arrays.items()}
    kind = int(rng.integers(len(OF_ONE) + len(OF_TABLE)))
    if kind >= len(OF_ONE):
        return OF_TABLE[kind - len(OF_ONE)](table, rng)
    name = list(table)[int(rng.integers(len(table)))]
    table[name] = OF_ONE[kind](table[name], rng)
    return table


def _shorter(values: NDArray[Any], rng: Generator) -> NDArray[Any]:
    return values[: int(rng.choice([0, 1, 2, len(values) // 2, len(values) - 1]))]


def _longer(values: NDArray[Any], rng: Generator) -> NDArray[Any]:
    return np.concatenate([values, values[: int(rng.integers(1, 9))]])


def _other_type(values: NDArray[Any], rng: Generator) -> NDArray[Any]:
    with np.errstate(all="ignore"):
        if not rng.integers(len(KINDS)):
            return (values * 1e9).astype(np.int64).astype("datetime64[ns]")
        return values.astype(str(rng.choice(KINDS)))


def _other_shape(values: NDArray[Any], rng: Generator) -> NDArray[Any]:
    shapes = (values.reshape(-1, 1), values.reshape(1, -1), values.reshape(1, 1, -1), values.ravel()[:1].reshape(()))
    return (*shapes, np.stack([values] * 3, 1))[int(rng.integers(5))] if values.ndim == 1 else values.reshape(-1)


def _wild(values: NDArray[Any], rng: Generator) -> NDArray[Any]:
    count = int(rng.choice([1, min(3, len(values)), len(values)]))
    values = values.astype(np.float64)
    values[rng.choice(len(values), count, replace=False)] = WILD[int(rng.integers(len(WILD)))]
    return values


def _scaled(values: NDArray[Any], rng: Generator) -> NDArray[Any]:
    return values * float(rng.choice([1e-9, 1e9, 1e300, -1.0]))


OF_ONE: tuple[Callable[[NDArray[Any], Generator], NDArray[Any]], ...] = (
    _shorter,
    _longer,
    _other_type,
    _other_shape,
    _wild,
    _wild,
    _scaled,
    lambda values, rng: rng.permutation(values),
    lambda values, _: np.full_like(values, values[0]),
)
"""Faults of one array."""


def _without_one(table: Arrays, rng: Generator) -> Arrays:
    del table[list(table)[int(rng.integers(len(table)))]]
    return table


def _renamed(table: Arrays, rng: Generator) -> Arrays:
    name = list(table)[int(rng.integers(len(table)))]
    return {(f"{key}_" if key == name else key): each for key, each in table.items()}


def _with_one_more(table: Arrays, rng: Generator) -> Arrays:
    return {**table, "q99" if rng.integers(2) else "x": next(iter(table.values()))}


def _short(table: Arrays, rng: Generator) -> Arrays:
    keep = int(rng.choice([0, 1, 2, 5, 20, 100]))
    return {key: each[:keep] for key, each in table.items()}


OF_TABLE: tuple[Callable[[Arrays, Generator], Arrays], ...] = (
    _without_one,
    _renamed,
    _with_one_more,
    _short,
    lambda table, _: {key: each[::-1] for key, each in table.items()},
)
"""Faults of a table."""
