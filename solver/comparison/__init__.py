"""Estimates compared with each other: two of them, or many over time; from estimates, never from readings."""
