"""Reproduction of the thesis [Halper2024]: each module computes one chapter or section; `page` shows the results.

Equation, table, figure and section numbers in this package are those of the thesis. "Table A.1" and "Table A.2" are
also the names of the motions whose Fourier coefficients these tables contain.
"""
