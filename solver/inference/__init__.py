"""Inference from a fit: intervals, verdicts and predictions."""
