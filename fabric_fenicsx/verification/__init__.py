"""Checks of what users add: laws, surfaces, terms."""
