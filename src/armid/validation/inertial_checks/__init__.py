"""Checks of the inertia that a description states for its bodies, against the shapes of these bodies."""
