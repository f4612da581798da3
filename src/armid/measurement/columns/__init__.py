"""Columns of a file: their names, units and clock, and the joint that each belongs to."""
