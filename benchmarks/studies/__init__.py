"""Studies: they prove numbers, such as how often an interval holds the truth, and compare no times."""
