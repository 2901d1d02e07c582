"""Jointstiff identifies the joint stiffnesses of an industrial robot from laser-tracker readings."""

from __future__ import annotations
