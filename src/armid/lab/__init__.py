"""Simulated recordings of arms with known parameters."""
