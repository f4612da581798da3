"""Contents of a page, computed from a run."""
