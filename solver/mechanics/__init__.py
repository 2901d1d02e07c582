"""The loaded robot: its kinematics, what was read of it, and terms, all that can move a target."""
