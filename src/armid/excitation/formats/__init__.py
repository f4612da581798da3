"""Catalogue of the motion formats of controllers; each format has its own module."""

from __future__ import annotations

from typing import cast

from armid.excitation.formats import csv, fri, mat, ros2, urscript
from armid.excitation.formats.sampled_motion import Format, SampledMotion

__all__ = ["FORMATS", "Format", "SampledMotion"]

FORMATS: dict[str, Format] = {
    "csv": cast("Format", csv),
    "ros2": cast("Format", ros2),
    "fri": cast("Format", fri),
    "urscript": cast("Format", urscript),
    "mat": cast("Format", mat),
}
"""Modules of the motion formats, by the name of the format."""
