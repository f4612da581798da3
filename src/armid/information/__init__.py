"""Square-root information: streaming triangular factors of the regressor's rows."""
