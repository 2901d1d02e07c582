"""Catalogue of nominal arms, and presets of joint maps."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from jointstiff.schemas.fields import Identifier, Message, Metres, Name
from jointstiff.schemas.robot import DhModel, JointMap


class JointMapPreset(Message):
    """Joint map that many controllers of a maker share.

    It holds for tables whose axes 2, 3 and 5 point the same way, and whose axes 4 and 6 point to the flange.
    """

    id: Identifier
    name: Name = Field(examples=["FANUC: J3 from the horizontal"])
    note: str = Field(description="What the controller shows.")
    joint_map: JointMap


class Arm(Message):
    """Nominal arm, by published figures. A real one differs from it by some tenths of a millimetre."""

    name: Name = Field(description="Maker and model.", examples=["KUKA KR 210 R2700 extra"])
    maker: Name
    model: DhModel
    joint_map: JointMap | None = Field(description="Map of the controller's angles; null: identity.")
    joint_map_preset: Identifier | None = Field(description="Preset that the joint map is; null: identity.")
    base: str = Field(description="Origin of R0, the frame of the controller.")
    reach: Metres[float] = Field(description="Reach, as the maker states it.")
    reach_of: Literal["wrist_centre", "flange", "stated"] = Field(
        description="Point whose largest distance from axis 1 the reach is, and was compared with; `stated`: "
        "the maker does not say it, and the table was compared with a second publication."
    )
    sources: list[str] = Field(description="Where the figures stand.")


class Catalogue(Message):
    """Nominal arms and presets of joint maps."""

    arms: list[Arm] = Field(description="Arms by maker.")
    joint_maps: list[JointMapPreset]
