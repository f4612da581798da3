"""Columns of a file: their names, units and joints, and the time column."""
