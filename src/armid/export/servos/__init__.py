"""Files about identified servos."""
