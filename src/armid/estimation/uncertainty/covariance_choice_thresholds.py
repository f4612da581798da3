"""Thresholds by which a covariance is chosen: whiteness, periods, blocks, spectrum and reversals."""

from __future__ import annotations

WHITENESS_LEVEL = 0.05
"""Significance level of the test of whiteness."""

FEWEST_PERIODS = 6
"""Fewest periods: with fewer, Student's intervals are more than a third wider than those of many periods."""

SAME_POSITIONS = 0.05
"""Largest RMS difference of the positions of two periods over their spread; control and phase cause up to 0.02."""

SAME_PRODUCTS = 0.2
"""Largest relative difference of the products of two blocks that count as periods of one motion. Noise of the
positions and masked rows near an end cause a few hundredths, another motion about one."""

MAX_REPEATED = 1.5
"""Largest variance of the mean residual of all periods, over that of independent periods, at which the residual
counts as not repeating. By chance it is 1 within one or two tenths."""

FEWEST_BLOCKS = 4
"""Fewest blocks for the scatter between blocks (three degrees of freedom); below, the white covariance is used."""

MIN_MERGED_BLOCKS = 10
"""Blocks are not made longer where fewer than these would be left."""

MAX_NEIGHBOUR_CORRELATION = 0.05
"""Largest correlation of the scores of neighbouring blocks at which blocks count as independent. It makes deviations
a twentieth too small, and occurs by chance with a few parameters and some twenty blocks."""

FEWEST_ROWS = 3
"""Fewest rows of all joints for each parameter with which a noise spectrum can be estimated."""

RATE_TOLERANCE = 0.1
"""Largest relative difference of the row rates of runs whose spectra are combined."""

SLOW_SHARE = 0.1
"""Share of its RMS speed below which a joint counts as reversing."""

MIN_INFORMATION = 0.1
"""Smallest share of a direction's information in rows away from reversals that allows a comparison."""

EXPECTED_SHIFT = 1.0
"""RMS over the parameters of the shift by reversals, in standard deviations, that is attributed to chance. Rows near
reversals are about a quarter of all; with a correct model they shift an estimate by half a standard deviation."""

SHIFT_SHARE = 0.65
"""Share of that shift that counts as one standard deviation: a 95 % interval then extends a quarter beyond the shift.
Set on simulated logs of twelve arms; one half left one arm below 88 % coverage. See docs/uncertainty.md."""
