"""Friction laws."""
