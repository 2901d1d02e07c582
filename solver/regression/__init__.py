"""Regressors: linear maps from joint compliances to what is read."""
