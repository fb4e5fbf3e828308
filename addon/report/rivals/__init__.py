"""Others that make the same layers, one file each."""
