"""Checks of the mass and inertia that a description states for its bodies, by comparison with the bodies' shapes."""
