"""Layers held against Cycles itself, which reads the scene in its own way."""
