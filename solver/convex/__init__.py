"""Convex programs, their solution and their certificates."""
