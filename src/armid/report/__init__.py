"""Pages about runs: what can be trusted, how well torque is predicted, what it was all made from."""
