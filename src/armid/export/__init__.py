"""Export of a run's model: robot descriptions with the identified values, checked by reading them back, and code."""
