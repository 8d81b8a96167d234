"""Tests as a user states them: dataclasses of numbers that make a scene and measure it."""
