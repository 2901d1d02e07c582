"""Maps: deflection and compliance over a work area."""

from jointstiff.service.kinds.room import Room

ROOM = Room(50, "map", "Map deflection and compliance over a work area.")
