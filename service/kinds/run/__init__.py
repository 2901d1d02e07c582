"""Runs: joint stiffnesses of a campaign."""

from jointstiff.service.kinds.room import Room

ROOM = Room(10, "identify", "Identify the joint stiffnesses of a campaign.")
