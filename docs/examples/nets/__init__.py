"""Nets of yarns that do not stretch."""
