"""Finished runs: their contents and their use."""
