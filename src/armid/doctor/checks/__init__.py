"""Checks of a log for faults; each file contains one check."""
