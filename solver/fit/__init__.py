"""Fits: readings as rows, models as cones, convex programs with certificates, estimates with intervals."""
