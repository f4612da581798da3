"""Reproduction of the thesis [Halper2024]: each module computes one chapter or section; `page` presents the results.

Equation, table, figure and section numbers in this package are those of the thesis. "Table A.1" and "Table A.2" are
also the names of the two motions whose Fourier coefficients these tables contain. "As printed" means an equation or
algorithm exactly as the thesis prints it; "with filtered columns" means that the filter of the torque is also applied
to the columns of the regressor.
"""
