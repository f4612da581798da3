"""Systematic errors of measurement and friction, and their effect on an estimate."""
