"""Plausibility checks of a measurement set: the usual mistakes of a long day."""
