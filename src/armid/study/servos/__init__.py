"""Studies of arms whose logs have commands and no torque: the table `[servo]`, its identification and its record."""
