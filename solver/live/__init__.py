"""A campaign while it is measured: is a reading believable, what to read next, when is it enough."""
