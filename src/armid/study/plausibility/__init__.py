"""Plausibility of an estimate: findings about it, and checks that fail because of errors in the recordings."""
