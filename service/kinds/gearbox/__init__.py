"""Gearboxes from two encoders: the name of the command."""

from jointstiff.service.kinds.room import Room

ROOM = Room(35, "gearbox", "Identify the stiffness of gearboxes from two encoders, without a tracker.")
