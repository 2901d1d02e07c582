"""The identified kinematic model, as DH table and as chain."""
