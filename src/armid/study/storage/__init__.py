"""Stored form of studies and results: JSON records, provenance, and folders that are written whole or not at all."""
