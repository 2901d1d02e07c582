"""Kinds of joints and the units and words of each kind, stated here and nowhere else.

A revolute joint turns about its axis: its position is an angle, a load is a torque about its axis, its
compliance c an angle per torque. A prismatic joint slides along its axis: a length, a force along it, and a
length per force. Arrays over the joints of a robot hold each joint's numbers in its own SI units: where a
comment says [rad], [N·m], [N·m/rad] or [rad/(N·m)] of all joints, it is [m], [N], [N/m] or [m/N] of the
prismatic ones.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Annotated, Final, Literal

from pydantic import Field

GOAL: Final = 1.5
"""Greatest ratio of the ends of an interval at which a stiffness is known: about ± 20 %, enough to choose
postures and to correct poses."""
IDENTIFIED: Final = 5.0
"""Greatest ratio of the ends of an interval at which a stiffness counts as identified: beyond it, readings
tell little more than the kind of the arm does."""
JointKind = Literal["revolute", "prismatic"]
StatedKind = Annotated[
    JointKind,
    Field(description="Kind of the joint; for `prismatic`, positions are in m and stiffnesses in N/m."),
]
"""Kind of a joint as messages state it."""


@dataclass(frozen=True)
class JointUnits:
    """Units and words of one kind of joint."""

    dimension: Literal["angle", "length"]  #: quantity of the joint's position; documents state the unit
    position: str  #: SI unit of the joint's position
    effort: str  #: SI unit of a torque or force on the joint
    stiffness: str  #: SI unit of the joint's stiffness
    compliance: str  #: SI unit of the joint's compliance
    million_stiffness: str  #: 10⁶ times the SI unit of stiffness, as shown to people
    micro_compliance: str  #: 10⁻⁶ times the SI unit of compliance, as shown to people
    load: str  #: phrase for a load on the joint, to be followed by the joint's name
    load_verb: str  #: verb for the effect of loads on the joint, plural
    loads: str  #: verb for the effect of a load on the joint, singular
    moves: str  #: verb for the motion of the joint, singular
    of_link: str  #: the link's motion that readings do not distinguish from the joint's, before "its axis"


JOINT_UNITS: Final[Mapping[JointKind, JointUnits]] = MappingProxyType(
    {
        "revolute": JointUnits(
            dimension="angle",
            position="rad",
            effort="N.m",
            stiffness="N.m/rad",
            compliance="rad/(N.m)",
            million_stiffness="10⁶ N·m/rad",
            micro_compliance="µrad/(N·m)",
            load="torque about the axis of",
            load_verb="twist",
            loads="twists",
            moves="turns",
            of_link="rotation about",
        ),
        "prismatic": JointUnits(
            dimension="length",
            position="m",
            effort="N",
            stiffness="N/m",
            compliance="m/N",
            million_stiffness="N/µm",
            micro_compliance="µm/N",
            load="force along the axis of",
            load_verb="push",
            loads="pushes",
            moves="slides",
            of_link="motion along",
        ),
    }
)
"""Units of each kind of joint."""
