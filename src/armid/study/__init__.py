"""Studies and their identification."""
