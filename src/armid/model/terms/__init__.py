"""Torque terms, one a file."""
