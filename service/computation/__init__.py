"""Computation without a store: from messages by the numerical core to results."""
