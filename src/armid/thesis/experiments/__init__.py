"""Additional experiments on the virtual arm: causes of the residual of the thesis, and other motions."""
