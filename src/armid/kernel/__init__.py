"""The compiled kernel, its NumPy twin and the choice between them."""
