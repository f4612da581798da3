"""Results of `armid servo` in a folder."""
