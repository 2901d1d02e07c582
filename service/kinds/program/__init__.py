"""Programs, compensated for the deflection under load."""

from jointstiff.service.kinds.room import Room

ROOM = Room(70, "compensate", "Compensate a program for the deflection under load.")
