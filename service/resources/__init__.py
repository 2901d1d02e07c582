"""Robots and measurement sets as stored resources; imports, which are not stored."""
