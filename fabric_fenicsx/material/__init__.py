"""Fabrics at a point: laws, kernel, stability, identification. Nothing here imports DOLFINx."""
