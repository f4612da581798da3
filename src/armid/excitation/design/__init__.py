"""Search for a trajectory: criteria, gradients, and descent."""
