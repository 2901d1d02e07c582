"""Identification by own weight: compliances, masses and geometry from unloaded positions (method.md §14)."""
