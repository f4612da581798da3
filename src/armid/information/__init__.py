"""Square-root information: triangular factors of the rows of the regressor, computed sample by sample."""
