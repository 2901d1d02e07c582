"""Corrections: tables of poses, corrected for the deflection under load."""

from jointstiff.service.kinds.room import Room

ROOM = Room(75, "correct", "Correct a table of poses for the deflection under load.")
