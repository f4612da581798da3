"""Monitoring of external torque: observer, thresholds from unseen motion, alarms, wrench at the tip."""
