"""Deflection over a work area."""
