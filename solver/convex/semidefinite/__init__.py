"""Semidefinite programs with a least-squares term."""
