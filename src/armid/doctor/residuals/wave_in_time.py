"""Wave in time that residuals contain: hum, an alias of a higher frequency, vibration of the base."""

from __future__ import annotations

import numpy as np

from armid.checked_array import Array
from armid.doctor.quick_fit import QuickRows
from armid.maths.signals.fourier_transform import fast_length, frequencies, spectrum

FINE = 2
"""Number of frequencies that are tried for each inverse length of the log."""

SLOWEST = 0.2
"""Lowest frequency of a wave [Hz]; slower ones look like changes along the log."""

NEARLY = 0.99
"""Largest share of a squared residual that counts as explained."""


LONGEST_GAP = 60.0
"""Gap between two rows at which the search for a frequency ends [s]: the memory of the search grows with the time."""


def strongest_wave(rows: QuickRows, residual: Array) -> tuple[float, Array]:
    """Frequency [Hz] of the wave that explains most of residuals, and its sine and cosine at the rows, shape (2, M).

    Args:
        rows: The rows.
        residual: Residuals, shape (M, k), each relative to its RMS.
    """
    time = rows.motion.time - rows.motion.time[0]
    piece = _longest_piece(time)
    place = np.round((time[piece] - time[piece.start]) * rows.rate).astype(np.intp)
    length = fast_length(FINE * int(place[-1] + 1))
    even = np.zeros((length, residual.shape[1]))
    even[place] = residual[piece]
    share = 2.0 * np.abs(spectrum(even)) ** 2 / max(len(place), 1) ** 2
    tried = frequencies(length) * rows.rate
    score = np.mean(-np.log1p(-np.minimum(share, NEARLY)), axis=1)
    frequency = float(tried[int(np.argmax(np.where(tried >= SLOWEST, score, 0.0)))])
    phase = 2.0 * np.pi * frequency * time
    return frequency, np.stack([np.sin(phase), np.cos(phase)])


def _longest_piece(time: Array) -> slice:
    """Rows of the longest piece without a gap of `LONGEST_GAP`, over which a wave does not keep its phase."""
    borders = np.concatenate([[0], np.flatnonzero(np.diff(time) > LONGEST_GAP) + 1, [len(time)]])
    longest = int(np.argmax(np.diff(borders)))
    return slice(int(borders[longest]), int(borders[longest + 1]))
