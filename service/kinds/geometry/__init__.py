"""Geometries: axes, base frame and targets of a robot."""

from jointstiff.service.kinds.room import Room

ROOM = Room(30, "geometry", "Identify the geometry of a robot from sweeps or poses.")
