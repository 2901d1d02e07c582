"""Estimates and their evidence: triangle, convex programs, methods, intervals, causes, verdicts."""
