"""Meshes of specimens, outlines and tools; `meshes/` has a script for each."""
