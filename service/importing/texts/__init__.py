"""Texts of one form each, such as a log or a list, rewritten to lines of cells."""
