"""Designed motions on disk: goals, placement, files, preflight, simulation."""
