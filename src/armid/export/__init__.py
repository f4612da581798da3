"""Export of the model of a run as a robot description, which is checked by reading it back, or as source code."""
