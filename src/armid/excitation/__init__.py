"""The motion to record."""
