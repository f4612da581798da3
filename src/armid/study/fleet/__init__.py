"""Fleets of units of one type of arm: FLEET.toml and its identification."""
