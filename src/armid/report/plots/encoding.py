"""Numbers and scripts as text that a page can hold."""

from __future__ import annotations

import base64
import gzip
import json
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = ["compressed", "embedded", "packed"]


def packed(values: ArrayLike, kind: str = "f4") -> dict[str, str]:
    """Numbers in the binary form that plotly.js reads too, in base 64, little end first.

    Args:
        values: The numbers, in C order.
        kind: Of each: `f4`, `u1`, `u2` or `u4`.
    """
    numbers: NDArray[Any] = np.ascontiguousarray(values, dtype=f"<{kind}")
    return {"dtype": kind, "bdata": base64.b64encode(numbers.tobytes()).decode()}


def embedded(record: Mapping[str, Any]) -> str:
    """JSON that cannot end the script element it stands in."""
    text = json.dumps(record, ensure_ascii=False, allow_nan=False, separators=(",", ":"))
    return text.replace("&", "\\u0026").replace("<", "\\u003c").replace(">", "\\u003e")


def compressed(text: str) -> str:
    """A script, compressed, in base 64; the same bytes each time."""
    return base64.b64encode(gzip.compress(text.encode(), 6, mtime=0)).decode()
