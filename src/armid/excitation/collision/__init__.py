"""Distances between bodies, and the pairs of bodies that a trajectory must keep apart."""
