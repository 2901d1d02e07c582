"""Two sides compared: encoders, before and after, two units."""
