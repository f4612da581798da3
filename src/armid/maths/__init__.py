"""Mathematics on arrays: knows no robots, files or plots."""
