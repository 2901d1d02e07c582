"""Kinds of work: a room for each, read from top to bottom."""
