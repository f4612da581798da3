"""Pages about runs: reliable and doubtful results, torque errors, parameters, and inputs of the run."""
