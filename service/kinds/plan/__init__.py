"""Plans: postures and loads of a campaign."""

from jointstiff.service.kinds.room import Room

ROOM = Room(40, "plan", "Plan which postures and loads to measure.")
