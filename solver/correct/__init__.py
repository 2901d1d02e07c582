"""Least deflection along a path: forces of the cut, turn about the spindle, place of the workpiece."""
