"""Corrections: tables of poses and robot programs, corrected for the deflection under load."""

from jointstiff.service.kinds.room import Room

ROOM = Room(70, "correct", "Correct poses or a robot program for the deflection under load.")
