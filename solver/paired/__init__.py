"""Comparison of two campaigns on one robot."""
