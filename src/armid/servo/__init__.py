"""Arms without torque in the log: gains of servos, friction and links from commands and measured positions."""
