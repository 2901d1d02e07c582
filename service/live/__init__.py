"""Campaigns that are measured live: the record of each, what it says, and where readings come from."""
