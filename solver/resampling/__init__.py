"""Resampling: fits of many random subsets of a measurement set."""
