"""Counts of readings."""

from jointstiff.service.kinds.room import Room

ROOM = Room(80, "count", "Count the readings of a set.")
