"""Plots and pictures of a page."""
