"""Energies of a sheet: membrane, bending, metal."""
