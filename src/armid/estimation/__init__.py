"""From information to estimates."""
