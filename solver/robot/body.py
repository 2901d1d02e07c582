"""Bodies of a robot with their masses: as people state them, or as a URDF has them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
import pinocchio as pin

from jointstiff.solver.errors import RequestError, RobotError
from jointstiff.solver.robot.chain import KinematicChain
from jointstiff.solver.robot.xml import parse_xml, read_numbers

STATED_BY_DEFAULT: Final = 0.2
"""Relative half-width of a mass whose uncertainty nobody states."""


@dataclass(frozen=True)
class Body:
    """A body, and how well it is known.

    Raises:
        RequestError: a number is not finite or negative, or the bounds do not enclose the mass.
    """

    name: str  #: for messages
    joint: int  #: index of the joint that carries it
    mass: float  #: m₀ [kg]
    least: float  #: bound of the mass from below [kg]
    most: float  #: bound of the mass from above [kg]
    centre: tuple[float, float, float]  #: centre of mass s in the frame that moves with the joint [m]
    radius: float = 0.0  #: R, how far from it the centre of mass may lie [m]

    def __post_init__(self) -> None:
        numbers = (self.mass, self.least, self.most, *self.centre, self.radius)
        if not np.isfinite(numbers).all() or self.radius < 0.0:
            raise self._refused("a number is not finite, or the radius negative")
        if not 0.0 <= self.least <= self.mass <= self.most or self.mass == 0.0:
            raise self._refused("the bounds do not enclose a positive mass")

    @classmethod
    def within(
        cls,
        name: str,
        joint: int,
        mass: float,
        centre: tuple[float, float, float],
        *,
        relative: float = STATED_BY_DEFAULT,
        radius: float = 0.0,
    ) -> Body:
        """Return a body whose mass is known to a relative half-width; 0 for exactly."""
        return cls(name, joint, mass, (1.0 - relative) * mass, (1.0 + relative) * mass, centre, radius)

    def _refused(self, reason: str) -> RequestError:
        return RequestError(
            reason, where=f"body '{self.name}'", remedy="give masses in kg, centres and radii in m"
        )


_LARGEST_MASS: Final = 1e6  # [kg]
_LARGEST_LENGTH: Final = 100.0  # [m]


def read_inertials(text: str, chain: KinematicChain) -> tuple[Body, ...]:
    """Read masses and centres of mass of the links on a chain from its URDF.

    What a URDF says of the inertia of other branches is not part of it, nor what stands before the first
    moving joint. A document with an inertial that makes no sense gives no bodies at all.

    Args:
        text: the document, which `read_urdf` has read.
        chain: what it read.
    """
    links = {link.attributes.get("name", ""): link for link in parse_xml(text).named("link")}
    bodies, placement, moving = [], pin.SE3.Identity(), -1
    try:
        for joint in chain.joints:
            placement = placement * pin.SE3(joint.rotation, joint.translation)
            if joint.is_moving:
                moving, placement = moving + 1, pin.SE3.Identity()
            inertial = links[joint.child].only("inertial", joint.child)
            mass = None if inertial is None else inertial.only("mass", joint.child)
            if inertial is None or mass is None or moving < 0:
                continue
            origin = inertial.only("origin", joint.child)
            xyz = "0 0 0" if origin is None else origin.attributes.get("xyz", "0 0 0")
            (value,) = read_numbers(mass.attributes.get("value", ""), 1, _LARGEST_MASS, joint.child)
            centre = placement * np.array(read_numbers(xyz, 3, _LARGEST_LENGTH, joint.child))
            if value:
                bodies.append(Body.within(joint.child, moving, value, tuple(centre.tolist())))
    except (RobotError, RequestError):
        return ()
    return tuple(bodies)
