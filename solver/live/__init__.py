"""Live campaigns: check of each reading, choice of the next reading, and progress towards the goal."""
