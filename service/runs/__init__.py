"""Answers that are made of stored runs at once: predictions, mends, trends, verdicts on their use."""
