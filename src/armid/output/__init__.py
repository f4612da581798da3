"""Output that survives a crash: locks of folders, atomic renames, groups of files, and removal of leftovers."""
