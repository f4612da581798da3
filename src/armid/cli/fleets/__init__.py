"""Command `armid fleet`."""
