"""The law at a point: parameters, energy, kernel, stability, identification. Nothing here imports DOLFINx."""
