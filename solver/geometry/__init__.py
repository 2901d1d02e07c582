"""Geometry from tracker points: axes, base frame, wrist centre, identified model."""
