"""Built-in arms, one description a file."""
