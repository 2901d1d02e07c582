"""Postures and loads to measure."""
