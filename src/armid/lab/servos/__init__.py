"""Virtual arms whose joints are moved by position servos, and recordings of their commands and positions."""
