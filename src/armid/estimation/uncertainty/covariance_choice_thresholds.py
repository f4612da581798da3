"""Thresholds for the choice of a kind of covariance: whiteness, periods, blocks, spectrum and reversals."""

from __future__ import annotations

WHITENESS_LEVEL = 0.05
"""Significance level of the test of whiteness."""

FEWEST_PERIODS = 6
"""Smallest number of periods for the scatter between periods. With fewer periods, intervals by Student's t
distribution are more than a third wider than with many periods."""

SAME_POSITIONS = 0.05
"""Largest RMS difference of the positions of two periods, divided by the spread of the positions, at which the motion
counts as the same. Errors of control and phase cause up to 0.02."""

SAME_PRODUCTS = 0.2
"""Largest relative difference between the normal matrices of two blocks with which the blocks count as periods of one
motion. Noise of the positions and masked rows near an end cause a few hundredths, another motion about one."""

MAX_REPEATED = 1.5
"""Largest variance of the mean residual of all periods, divided by its value for independent periods, at which the
residual counts as not repeating. For independent periods the ratio is from 0.8 to 1.2."""

FEWEST_BLOCKS = 4
"""Smallest number of blocks for the scatter between blocks (three degrees of freedom). With fewer blocks the white
covariance is used."""

MIN_MERGED_BLOCKS = 10
"""Smallest number of merged blocks: blocks are not merged further if fewer would remain."""

MAX_NEIGHBOUR_CORRELATION = 0.05
"""Largest correlation of the gradients of neighbouring blocks at which blocks count as independent. A correlation of
this size makes standard deviations a twentieth too small. It occurs by chance with few parameters and about twenty
blocks."""

FEWEST_ROWS = 3
"""Smallest number of rows of all joints, divided by the number of parameters, for the estimate of a noise
spectrum."""

RATE_TOLERANCE = 0.1
"""Largest relative difference between the row rates [Hz] of runs whose spectra are combined."""

SLOW_SHARE = 0.1
"""Share of the RMS speed of a joint below which the joint counts as reversing."""

MIN_INFORMATION = 0.1
"""Smallest share of the information about a direction of the parameters that rows away from reversals must contain.
With a smaller share, the estimates with and without rows near reversals are not compared in this direction."""

EXPECTED_SHIFT = 1.0
"""Largest shift of an estimate by rows near reversals that is attributed to chance: RMS over the parameters, in
standard deviations. About a quarter of all rows are near reversals; if the model is correct, they shift an
estimate by half a standard deviation."""

SHIFT_SHARE = 0.65
"""Share of the shift by rows near reversals that counts as one standard deviation. A 95 % interval then extends a
quarter beyond the shift. The value was chosen on simulated recordings of twelve arms; with 0.5 the coverage of one
arm was below 88 %. See docs/uncertainty.md."""
