"""Columns of a file: names, units, clock, and the joint of each."""
