"""Inputs of the kinds of work: robot, readings and run, from a store or from files."""
