"""Admission: size, host and origin, keys and roles; and the receivers of webhooks."""
