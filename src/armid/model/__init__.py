"""Dependence of the torque: motion, torque terms, regressor, base parameters."""
