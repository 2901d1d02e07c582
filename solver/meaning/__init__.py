"""The meaning of tables of numbers, by the kinematics of the robot that was measured (method.md §17)."""
