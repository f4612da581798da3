"""Checks of the signals, without a dynamic model."""
