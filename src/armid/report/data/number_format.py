"""Text of numbers for a page: the interval determines the digits, and the minus sign is typographic."""

from __future__ import annotations

import math

MOST_DECIMALS = 9
"""Largest number of decimals; further decimals are noise in every unit of the tables."""

MISSING = "–"

LARGEST_PLAIN, SMALLEST_PLAIN = 1e6, 1e-4
"""Largest and smallest absolute value that is written without a power of ten."""

SMALLEST_SHARE = 0.001
"""Smallest share that is shown as a number; a smaller share is shown as "less than 0.1 %"."""


def fixed(value: float, decimals: int) -> str:
    """Text of a number with the given decimals; a dash if the number is not finite."""
    if not math.isfinite(value):
        return MISSING
    text = f"{value:.{decimals}f}"
    return text.replace("-", "−") if float(text) else text.removeprefix("-")


def decimals_of(uncertainty: float, digits: int = 2) -> int:
    """Number of decimals with which an uncertainty has the given number of significant digits."""
    if not 0.0 < uncertainty < math.inf:
        return 3
    return min(max(0, digits - 1 - math.floor(math.log10(uncertainty))), MOST_DECIMALS)


def with_half_width(value: float, half: float) -> str:
    """Number with the half width of its interval, both with as many decimals as the half width deserves."""
    decimals = decimals_of(half)
    return f"{fixed(value, decimals)} ± {fixed(half, decimals)}"


def short(value: float, digits: int = 3) -> str:
    """Text of a number with the given significant digits, for instance 0.0839 or 2.4 · 10⁻⁶."""
    if not math.isfinite(value):
        return MISSING
    if value == 0.0:
        return "0"
    size = abs(value)
    if SMALLEST_PLAIN <= size < LARGEST_PLAIN:
        return fixed(value, max(0, digits - 1 - math.floor(math.log10(size))))
    mantissa, exponent = f"{value:.{digits - 1}e}".split("e")
    power = str(int(exponent)).translate(str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"))
    return f"{mantissa.replace('-', '−')} · 10{power}"


def share(value: float) -> str:
    """Share as text in percent; one decimal below two percent, otherwise no decimals."""
    if not math.isfinite(value):
        return MISSING
    if 0.0 < abs(value) < SMALLEST_SHARE:
        return f"less than {100.0 * SMALLEST_SHARE:g}\u00a0%"
    return f"{fixed(100.0 * value, 1 if 0.0 < abs(value) < 0.02 else 0)}\u00a0%"


def percent(value: float) -> str:
    """Relative standard deviation [%] as text; `> 999` from a thousand on."""
    if not value < 1000.0:
        return "> 999"
    return fixed(value, 1) if value >= 1.0 else short(value, 2)
