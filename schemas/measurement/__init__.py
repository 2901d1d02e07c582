"""Messages about measurement sets."""
