"""Sampled signals: filters, spectra, derivatives, resampling and delays."""
