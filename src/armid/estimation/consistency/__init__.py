"""Physical consistency: cones of real bodies, and the convex programs over them."""
