"""Checks of commands and of torques in logs of servos."""
