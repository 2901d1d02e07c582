"""Translation between messages (schemas) and the numerical core (solver)."""
