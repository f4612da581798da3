"""Built-in arms; each has its own description."""
