"""The sheet: its mesh, its yarn directions, and what its mesh must be."""
