"""Messages of a bridge from a tracker to the page that shows a reading."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field, StrictBool

from jointstiff.schemas.fields import (
    Identifier,
    Message,
    Metres,
    Name,
    Newtons,
    Positions,
    Quantity,
    Timestamp,
    Vector3,
)
from jointstiff.schemas.measurement import MAX_TARGETS
from jointstiff.schemas.robot import MAX_JOINTS

MAX_CODE_LENGTH = 32
"""Greatest length of a code as a person types it, with blanks and hyphens."""
MAX_TROUBLE_LENGTH = 500
MAX_NAMES = 4 * MAX_TARGETS
"""Greatest number of names that a tracker sends and that are not names of targets."""


class BridgeStand(Message):
    """Posture and load that a page shows, in which the tracker reads."""

    number: Annotated[int, Field(strict=True, ge=0, le=10**15)] = Field(
        description="Number of the shown posture and load; the tracker's positions are sent with this number."
    )
    label: Name
    joints: Positions[Annotated[list[Quantity], Field(min_length=1, max_length=MAX_JOINTS)]]
    force: Newtons[Vector3]
    loaded: StrictBool = Field(
        description="True if the load acts on the robot while the tracker reads the targets."
    )
    names: Annotated[dict[Name, Name | None], Field(max_length=MAX_NAMES)] = Field(
        default_factory=dict,
        description="Name of the target for each name that the tracker uses; null if the name is ignored.",
    )


class BridgePoints(Message):
    """Positions that a tracker read in one posture, or the reason why the tracker read none."""

    number: int | None = Field(
        default=None,
        strict=True,
        ge=0,
        description="Number of the posture under load to which the positions belong.",
    )
    points: Annotated[dict[Name, Metres[Vector3]], Field(max_length=MAX_TARGETS)] = Field(
        default_factory=dict, description="Last position of each target, in the frame of the set's readings."
    )
    unknown: Annotated[dict[Name, Metres[Vector3]], Field(max_length=MAX_NAMES)] = Field(
        default_factory=dict,
        description="Last position of each name of the tracker that is not a target, in the frame of the "
        "set's readings.",
    )
    trouble: Annotated[str, Field(max_length=MAX_TROUBLE_LENGTH)] | None = Field(
        default=None, description="Reason why the tracker gives no position; null if the tracker reads."
    )


class BridgeCode(Message):
    """Typed code of a bridge."""

    code: Annotated[str, Field(min_length=1, max_length=MAX_CODE_LENGTH)]


class Bridge(Message):
    """A new bridge, or a bridge that a command has joined."""

    id: Identifier
    set_id: Identifier
    code: str | None = Field(
        default=None, description="Code to type at the terminal to connect the tracker; only for the page."
    )
    ends_at: Timestamp = Field(
        description="Time at which the code expires; after a command has connected, time at which the "
        "connection ends."
    )


class BridgeState(Message):
    """State of a bridge, as the page follows it."""

    joined: StrictBool
    connected: StrictBool = Field(
        description="True if the connected command sent a message within the last seconds."
    )
    reading: BridgePoints


class BridgeTask(Message):
    """Posture and load in which a command reads; null while the page shows none."""

    stand: BridgeStand | None
