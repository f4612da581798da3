"""Reduction of recordings with a high sample rate, or with very many samples, while they are read."""
