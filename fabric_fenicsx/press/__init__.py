"""Presses as data, how they are built, and what their jobs write."""
