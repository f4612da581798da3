"""Encoding of numbers and scripts as text for a page."""

from __future__ import annotations

import base64
import gzip
import json
import zlib
from collections.abc import Mapping
from importlib.metadata import version
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from armid.errors import ArmidError
from armid.excitation.collision.cache import read_entry, write_entry


def packed(values: ArrayLike, kind: str = "f4") -> dict[str, str]:
    """Encodes numbers as little-endian binary data in base 64, a form that plotly.js reads.

    Args:
        values: The numbers, in C order.
        kind: Type of the numbers: `f4`, `u1`, `u2` or `u4`.
    """
    numbers: NDArray[Any] = np.ascontiguousarray(values, dtype=f"<{kind}")
    return {"dtype": kind, "bdata": base64.b64encode(numbers.tobytes()).decode()}


def embedded(record: Mapping[str, Any]) -> str:
    """JSON text for a script element of HTML; characters that could end the element are escaped.

    Raises:
        ArmidError: A number is not finite.
    """
    try:
        text = json.dumps(record, ensure_ascii=False, allow_nan=False, separators=(",", ":"))
    except ValueError as error:
        raise ArmidError(
            "The page cannot be written, because a number on it is not finite.",
            remedy="look for numbers beyond 1e100 in the description and in the files given, and correct them.",
        ) from error
    return text.replace("&", "\\u0026").replace("<", "\\u003c").replace(">", "\\u003e")


def literal(text: str) -> str:
    """Text that plotly shows as it is: without elements of HTML, links and inserted values."""
    return text.replace("&", "&amp;").replace("<", "&lt;").replace(">", "&gt;").replace("%{", "%&#123;")


def compressed(text: str) -> str:
    """Compresses a script and encodes it in base 64; equal scripts give equal texts."""
    return base64.b64encode(_gzipped(text)).decode()


def unpacked(text: str) -> str:
    """Script that `compressed` encoded."""
    return gzip.decompress(base64.b64decode(text)).decode()


def packed_plotly() -> str:
    """plotly.js, compressed by `compressed` once for each version and stored in the cache."""
    name = f"plotly-{version('plotly')}-zlib-{zlib.ZLIB_RUNTIME_VERSION}"
    stored = read_entry(name)
    if stored is not None and "script" in stored:
        return base64.b64encode(stored["script"].tobytes()).decode()
    from plotly.offline import get_plotlyjs

    script = _gzipped(get_plotlyjs())
    write_entry(name, {"script": np.frombuffer(script, dtype=np.uint8)})
    return base64.b64encode(script).decode()


def _gzipped(text: str) -> bytes:
    return gzip.compress(text.encode(), 6, mtime=0)
