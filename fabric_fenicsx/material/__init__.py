"""Fabrics and metals at a point: laws, kernel, stability. Nothing here imports DOLFINx."""
