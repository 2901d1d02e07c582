"""Columns of files: those that a proposal does not read, and those that the caller states."""
