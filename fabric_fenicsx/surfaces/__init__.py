"""Rigid surfaces, and the tools that carry them.

A surface bounds a body; its normal points out of it, and the gap (signed distance) is positive
outside. `Surface` and `ImplicitSurface` are the bases of own surfaces.
"""
