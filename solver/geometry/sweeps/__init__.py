"""Joint axes from sweeps of one joint at a time."""
