"""Commands that plan or simulate a motion."""
