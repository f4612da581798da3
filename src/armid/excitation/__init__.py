"""Design and check of the motion to record."""
