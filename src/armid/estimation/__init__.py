"""Estimates from information: methods, consistency, friction, uncertainty and updates."""
