"""Optimal design of campaigns: which postures and loads to measure, with a certificate."""
