"""Design of commands that show gains, rotor inertia, friction and delay through servos."""
