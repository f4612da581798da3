"""What the torque depends on: motion, torque terms, regressor, base parameters."""
