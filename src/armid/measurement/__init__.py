"""Recordings and what processing makes of them."""
