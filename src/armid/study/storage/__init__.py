"""Stored form of studies and results: JSON records, provenance, folders written at once."""
