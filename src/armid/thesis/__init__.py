"""Reproduction of the thesis [Halper2024]: each module computes one chapter or section; `page` shows the results."""
