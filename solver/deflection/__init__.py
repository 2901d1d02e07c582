"""Deflection and Cartesian compliance by an identified model, with intervals."""
