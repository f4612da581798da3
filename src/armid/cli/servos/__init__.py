"""Command for arms whose logs have commands and no torque."""
