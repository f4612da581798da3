"""Constraints of a motion, with gradients: positions and their derivatives, torques, and workspace."""
