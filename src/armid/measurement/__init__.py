"""Recordings, their readers, and their processing to observations."""
