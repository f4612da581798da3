"""Prediction on unseen motion."""
