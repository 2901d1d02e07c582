"""The frame of a measurement set's positions, where it is not R0: a tracker's."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from jointstiff.schemas.fields import Dimensionless, Identifier, Message, Metres, Name, Vector3

Rotation = tuple[Vector3, Vector3, Vector3]


class Frame(Message):
    """Positions are in a tracker's frame: by a geometry, or by an explicit transform to R0."""

    geometry_id: Identifier | None = Field(
        default=None,
        description="Geometry of the same robot, measured by the same tracker from the same station.",
    )
    rotation: Dimensionless[Rotation | None] = Field(
        default=None, description="Rotation matrix row by row, tracker to R0."
    )
    translation: Vector3 | None = Field(
        default=None, description="The tracker's origin in R0, in units.length."
    )
    base_targets: Annotated[dict[Name, Vector3], Field(min_length=3, max_length=16)] | None = Field(
        default=None,
        description="Base targets of the geometry (needs `geometry_id`), read again with this set, in "
        "units.length. The motion between tracker and robot since then is corrected, with a "
        "warning.",
    )
    forces: Literal["base", "tracker"] = Field(
        default="base",
        description="Frame of forces and moments: R0, or the tracker's frame, for instance if a weight pulls "
        "along the vertical of a levelled tracker.",
    )

    @model_validator(mode="after")
    def _one_kind(self) -> Frame:
        explicit = self.rotation is not None and self.translation is not None
        partly = self.rotation is not None or self.translation is not None
        if (self.geometry_id is not None) == partly or partly != explicit:
            raise ValueError("give either `geometry_id`, or both `rotation` and `translation`")
        if self.base_targets is not None and self.geometry_id is None:
            raise ValueError("give `geometry_id` with `base_targets`: they are compared with the geometry's")
        return self


class ResolvedFrame(Message):
    """Frame as resolved when the set was stored; it remains valid if the geometry is deleted."""

    rotation: Dimensionless[Rotation] = Field(description="Rotation matrix row by row, tracker to R0.")
    translation: Metres[Vector3] = Field(description="The tracker's origin in R0.")
    flange_targets: Metres[dict[Name, Vector3]] = Field(
        description="Targets of the geometry in the flange frame, used for deflections of targets "
        "that the set "
        "does not place; empty if it has another flange frame."
    )
