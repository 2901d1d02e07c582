"""Errors of the service, and the problem documents that tell them (RFC 9457)."""
