"""Names of the rows of tables: which observation, target, state and load each row speaks of."""
