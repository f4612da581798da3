"""Fleets on disk: folder, reader, and comparison with an earlier fleet."""
