"""Calculations of single studies, for the scripts one folder up."""
