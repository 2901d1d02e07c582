"""Processes: least deflection along a path, by turns about the spindle and places of the workpiece."""

from jointstiff.service.kinds.room import Room

ROOM = Room(80, "process", "Turn the tool and place the workpiece for the least deflection along a path.")
