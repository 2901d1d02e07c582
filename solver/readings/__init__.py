"""Readings in SI units: measurement sets, secondary encoders and tracker noise."""
