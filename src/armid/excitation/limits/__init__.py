"""Constraints of a motion with gradients: positions, velocities, torques, workspace."""
