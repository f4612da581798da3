"""Built-in arms, with one description for each."""
