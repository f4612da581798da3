"""Search for an optimal trajectory: criteria, gradients and descent."""
