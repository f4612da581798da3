"""Estimation of dynamic parameters: estimators, physical consistency, friction, uncertainty and updates."""
