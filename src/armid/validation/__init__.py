"""Validation of estimated parameters: torque error, rollout and physical consistency."""
