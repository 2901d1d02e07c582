"""Whether the <inertial> of a URDF link could belong to a body. It is checked, and then dropped.

Stiffness identification needs no masses; but a document whose masses are nonsense is not one to
trust.
"""

from __future__ import annotations

import numpy as np

from jointstiff.solver.errors import RobotError
from jointstiff.solver.robot.xml_guard import XmlElement
from jointstiff.solver.robot.xml_values import ORIGIN, read_numbers, read_triples

__all__ = ["INERTIA_TOLERANCE", "LARGEST_INERTIA", "LARGEST_MASS", "check_inertial"]

LARGEST_MASS = 1e6
"""Largest mass of a link [kg]."""

LARGEST_INERTIA = 1e9
"""Largest entry of an inertia matrix [kg·m²]."""

INERTIA_TOLERANCE = 0.01
"""Share of the largest principal moment by which rounding in a CAD export may break the rules."""

_ENTRIES = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")


def check_inertial(inertial: XmlElement, link: str) -> None:
    """Check that mass and inertia are those of a body.

    The mass is positive; the principal moments are not negative, and none exceeds the sum of the
    other two. A dummy link may have no mass if it has no inertia either.

    Args:
        inertial: the <inertial> element.
        link: place of the link, for the message.

    Raises:
        RobotError: <mass> or <inertia> is missing, has no finite numbers, or is not physical.
    """
    read_triples(inertial, "origin", ORIGIN, link)
    mass = _mass(inertial, link)
    inertia = _inertia(inertial, link)
    if mass == 0.0 and inertia.any():
        raise RobotError(
            "an inertia without a mass",
            remedy="give the mass in kg, or remove <inertial>, which is not used here",
            where=f"{link} <mass>",
        )
    moments = np.linalg.eigvalsh(inertia)  # ascending
    slack = INERTIA_TOLERANCE * abs(moments).max()
    if moments[0] < -slack or moments[2] > moments[0] + moments[1] + slack:
        raise RobotError(
            "no body has the principal moments of inertia "
            + ", ".join(f"{moment:.3g}" for moment in moments)
            + " kg·m²",
            remedy="correct it so that none is negative or exceeds the sum of the others, "
            "or remove <inertial>, which is not used here",
            where=f"{link} <inertia>",
        )


def _mass(inertial: XmlElement, link: str) -> float:
    (mass,) = read_numbers(_attribute(inertial, "mass", "value", link), 1, LARGEST_MASS, f"{link} <mass>")
    if mass < 0.0:
        raise RobotError(
            f"a negative mass, {mass:g} kg", remedy="give a positive mass", where=f"{link} <mass>"
        )
    return mass


def _inertia(inertial: XmlElement, link: str) -> np.ndarray[tuple[int, int], np.dtype[np.float64]]:
    xx, xy, xz, yy, yz, zz = (
        read_numbers(
            _attribute(inertial, "inertia", entry, link),
            1,
            LARGEST_INERTIA,
            f"{link} <inertia> {entry}",
        )[0]
        for entry in _ENTRIES
    )
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


def _attribute(inertial: XmlElement, tag: str, name: str, link: str) -> str:
    elements = inertial.named(tag)
    if len(elements) != 1 or name not in elements[0].attributes:
        raise RobotError(
            f"<inertial> needs one <{tag}> with {name}",
            remedy="complete <inertial>, or remove it: it is not used here",
            where=f"{link} <{tag}>",
        )
    return elements[0].attributes[name]
