"""Sheets as data and meshed, stacks of them, and meshes of specimens and outlines."""
