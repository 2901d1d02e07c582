"""Stiffness without a load: compliances, own weight and geometry from unloaded positions (method.md §14)."""
