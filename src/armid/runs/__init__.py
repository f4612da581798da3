"""Finished runs: contents of the folder of a run, and prediction, update and certification from a run."""
