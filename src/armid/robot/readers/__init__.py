"""Readers of robot descriptions, one format a file."""
