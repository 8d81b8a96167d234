"""Energies and loads of sheets: terms of a scene."""
