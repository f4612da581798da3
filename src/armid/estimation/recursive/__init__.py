"""Recursive least squares: an estimate that is updated with each new block of rows and forgets old rows."""
