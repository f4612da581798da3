"""Numerical functions on arrays, independent of robots, files and plots."""
