"""Kinematic geometry of a robot from circle-point sweeps or poses."""
