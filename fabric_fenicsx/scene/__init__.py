"""Scenes, their supports and their output."""
