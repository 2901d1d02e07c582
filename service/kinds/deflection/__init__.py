"""Deflections under given loads, which are not stored."""
