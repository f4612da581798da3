"""Export of the model of a run: as a robot description, which is read back and checked, or as source code."""
