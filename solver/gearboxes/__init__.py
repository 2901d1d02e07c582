"""Gearboxes: their stiffness from the angles of two encoders, without a tracker (method.md §18)."""
