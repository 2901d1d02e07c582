"""Several methods on one measurement set, side by side."""
