"""Fleets: campaigns of many robots in one job."""

from jointstiff.service.kinds.room import Room

ROOM = Room(60, "fleet", "Identify the campaigns of many robots in one job.")
