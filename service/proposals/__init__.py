"""Proposals for the meaning of files: the robot finds the meaning of their columns, a person accepts it."""
