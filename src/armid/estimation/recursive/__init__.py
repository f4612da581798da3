"""Recursive least squares with forgetting."""
