"""Admission: size, host and origin, keys and roles."""
