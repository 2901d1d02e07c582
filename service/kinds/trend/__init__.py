"""Stiffness over time."""
