"""Designed motions: goals, start poses, surroundings, plan files, preflight reports, and files of simulations."""
