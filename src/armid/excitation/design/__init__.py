"""The search for a trajectory: criteria, gradients, descent."""
