"""Design of the motion to record, and check of this motion against all limits."""
