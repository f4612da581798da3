"""Physical consistency: cones of the parameters that real bodies can have, and convex programs over these cones."""
