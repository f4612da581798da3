"""Checks of what the residual of a fitted model depends on: torques of other joints, angles, velocities."""
