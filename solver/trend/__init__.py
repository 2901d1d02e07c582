"""Charts of the joints' stiffness over campaigns: baseline, EWMA, limits and alarms."""
