"""Axes, frames and links from sweeps or poses."""
