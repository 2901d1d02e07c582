"""Terms: everything that can move a target, each by the columns of its unknowns."""
