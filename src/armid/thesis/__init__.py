"""The study of the thesis [Halper2024] from end to end: one module a chapter, values out, nothing drawn."""
