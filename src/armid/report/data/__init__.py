"""Contents of the page of a run, computed from the run and its recordings."""
