"""Descriptions of the built-in arms."""
