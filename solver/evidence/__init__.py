"""Evidence of a fit: intervals, budget, causes, predictions, verdicts."""
