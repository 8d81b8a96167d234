"""Scenes, their supports and what they tell."""
