"""Use from Python: campaigns in process, and a client of the service."""
