"""Elastic links as positive semidefinite compliance matrices."""
