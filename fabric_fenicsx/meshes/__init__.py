"""Mesh generators of specimens and tools; each runs by itself too."""
