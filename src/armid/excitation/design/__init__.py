"""Search for an optimal motion: criteria, their gradients, and descent."""
