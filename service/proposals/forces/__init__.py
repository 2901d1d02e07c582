"""Forces of the postures: their columns, units and axes, and the weights that hang."""
