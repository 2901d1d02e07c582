"""Fits of the joint compliances by the three methods."""
