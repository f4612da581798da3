"""Ensembles: possible arms, drawn from the distribution of the estimate."""
