"""Pages about runs: which results can be trusted, the torque error, and the inputs of the run."""
