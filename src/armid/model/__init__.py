"""Model of the joint torque: motion, torque terms, regressor, base parameters."""
