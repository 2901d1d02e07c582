"""Prediction by an identified model: deflections, maps, compensated paths, and how far they may be off."""
