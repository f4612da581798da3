"""Tests of what the residual of a fitted model contains: added columns, and torques that are late."""
