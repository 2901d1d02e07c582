"""Sizes of what is taken from outside."""

from __future__ import annotations

from typing import Final

__all__ = ["MAX_SET_BYTES"]

MAX_SET_BYTES: Final = 8 * 1024 * 1024
"""A measurement set, or a file with one."""
