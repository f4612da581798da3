"""Checks of the signals by themselves."""
