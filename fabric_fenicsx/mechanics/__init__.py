"""Energies and loads that a scene is made of."""
