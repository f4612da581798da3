"""Simulation of recordings of arms whose parameters are known."""
