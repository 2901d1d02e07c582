"""The child process that answers large bodies for a service."""
