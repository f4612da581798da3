"""Checks that compare the recording with a dynamic model."""
