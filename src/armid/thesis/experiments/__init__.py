"""Experiments on the virtual arm that the thesis does not have: causes of its residual, and other motions."""
