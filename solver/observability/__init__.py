"""Observability of joints and of their combinations."""
