"""Correction of poses by the model of a run or by a prior: tables in, and tables out. Nothing is stored."""
