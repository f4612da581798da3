"""Distances between bodies, and the pairs that a trajectory keeps apart."""
