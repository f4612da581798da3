"""What a study says, and the run it becomes."""
