"""Build robots from DH tables and URDFs, and compute their kinematics."""
