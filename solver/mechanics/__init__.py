"""Mechanics of the loaded robot: kinematics, measurements, and terms, the causes that can move a target."""
