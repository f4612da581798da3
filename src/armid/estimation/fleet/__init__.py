"""Fleets: many units of one type of arm with common bodies, and with friction, offsets and gains of each unit."""
