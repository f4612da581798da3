"""Covariance of an estimate: noise spectra, scatter between blocks, reversals."""
