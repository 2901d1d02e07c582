"""Messages about geometries."""
