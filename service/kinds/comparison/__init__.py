"""Comparisons: methods on one campaign, or two campaigns of one robot."""

from jointstiff.service.kinds.room import Room

ROOM = Room(20, "compare", "Compare methods on a campaign, or two campaigns of one robot.")
