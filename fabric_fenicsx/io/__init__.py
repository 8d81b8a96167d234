"""Readers of meshes, outlines and tables of numbers; values that depend on the place."""
