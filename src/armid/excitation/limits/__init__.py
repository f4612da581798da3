"""Limits that a trajectory keeps, with gradients: positions, velocities, torques, workspace."""
