"""Reproduction of the reference study [Halper2024]: one module a chapter computes values; `page` draws them."""
