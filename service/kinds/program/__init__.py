"""Robot programs, corrected."""
