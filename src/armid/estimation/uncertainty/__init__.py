"""Covariance of an estimate: from noise spectra, from the scatter between blocks, and from velocity reversals."""
