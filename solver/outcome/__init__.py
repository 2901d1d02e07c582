"""Outcome of a run: evidence for the chosen model, verdict, and the message of the result."""
