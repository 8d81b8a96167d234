"""Quasi-static membrane finite elements for woven fabrics on FEniCSx (mm, N, MPa, rad)."""

__version__ = "0.1.0"
