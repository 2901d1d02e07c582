"""Mean forces of milling over a turn of the tool, by Kienzle's specific cutting force.

``F_c = k_c1.1 b h^(1 − m_c)``: Kienzle, *Die Bestimmung von Kräften und Leistungen an spanenden Werkzeugen
und Werkzeugmaschinen*, VDI-Z 94 (1952) 299–305. k_c1.1 and m_c of the materials: Iscar, *Turning tools*
(2017), p. 558, groups of VDI 3323.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Final, Literal

import numpy as np

from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.errors import RequestError
from jointstiff.solver.text import figure

Direction = Literal["climb", "conventional"]
UNCERTAINTY: Final = 0.25
"""Relative standard uncertainty of forces that are computed from the cut, unless another is stated."""
_ANGLES: Final = 720
"""Angles of the tool at which the forces of a tooth are evaluated."""
_MILLIMETRE: Final = 1e-3


@dataclass(frozen=True)
class Material:
    """Specific cutting force of a material."""

    pressure: float  #: k_c1.1, cutting force of a chip 1 mm wide and 1 mm thick [N/mm²]
    exponent: float  #: m_c [1]
    group: str  #: group of VDI 3323


MATERIALS: Final[Mapping[str, Material]] = MappingProxyType(
    {
        "steel": Material(1500.0, 0.22, "2: unalloyed steel, from 0.25 % C, annealed"),
        "alloy_steel": Material(1725.0, 0.24, "8: low-alloy steel, quenched and tempered"),
        "stainless_steel": Material(2150.0, 0.20, "14: austenitic stainless steel"),
        "cast_iron": Material(1350.0, 0.28, "18: grey cast iron, pearlitic"),
        "aluminium": Material(800.0, 0.25, "22: wrought aluminium, cured"),
        "titanium": Material(2110.0, 0.22, "37: titanium, alpha and beta alloys"),
        "nickel": Material(3300.0, 0.24, "33: alloys of nickel or cobalt, annealed"),
    }
)
"""Materials by name."""


@dataclass(frozen=True)
class Cut:
    """Milling with the side of a cylindrical tool, or slotting if the width is the diameter."""

    material: Material
    diameter: float  #: of the tool [m]
    teeth: int  #: number z of teeth
    speed: float  #: of the spindle [1/s]
    feed: float  #: speed of the tool along its path [m/s]
    depth: float  #: of the cut along the spindle axis [m]
    width: float  #: of the cut across the feed [m], at most the diameter
    direction: Direction = "climb"
    radial: float = 0.35  #: radial force relative to the cutting force; assumed unless it is stated
    axial: float = 0.0  #: force along the spindle, from the tip to the spindle, relative to the cutting force

    def __post_init__(self) -> None:
        for name in ("diameter", "teeth", "speed", "feed", "depth", "width"):
            if not getattr(self, name) > 0.0:
                raise RequestError(
                    f"the {name} of the cut is not positive",
                    where=f"cut.{name}",
                    remedy="give a positive number",
                )
        if self.width > self.diameter * (1.0 + 1e-9):
            raise RequestError(
                "the width of the cut exceeds the tool's diameter",
                where="cut.width",
                remedy="give the width across the feed that the tool engages, at most its diameter",
            )
        if self.feed_per_tooth > 0.5 * self.diameter:
            chip = figure(1e3 * self.feed_per_tooth, ".3g")
            raise RequestError(
                f"the feed is {chip} mm a tooth, more than the tool's radius",
                where="cut.feed",
                remedy="give the feed in m/s, and the speed of the spindle in turns per second",
            )

    @property
    def feed_per_tooth(self) -> float:
        """Feed of a tooth in one turn of the tool [m]."""
        return self.feed / (self.teeth * self.speed)

    def mean_force(self) -> FloatArray:
        """Return the mean force (3,) on the tool over a turn [N]: along feed, normal and spindle axis.

        The spindle axis a points from spindle to tip, and the normal is ``n = a × f``: seen from the spindle,
        it points to the right of the feed f. A spindle that turns to the right carries a tooth from f to n.
        At the angle θ from f the chip is ``h = f_z cos θ`` thick, and the force on the tooth is
        ``−F_c e_t − ρ F_c e_r``, plus the axial part, with ``e_r = f cos θ + n sin θ`` and e_t across e_r. In
        climb milling the workpiece is to the right of the feed, in conventional milling to the left.
        """
        # The engaged arc in the direction across the feed, from −1 to 1 in units of the tool's radius
        edge = np.clip(1.0 - 2.0 * self.width / self.diameter, -1.0, 1.0)
        start, end = np.arcsin(edge), 0.5 * np.pi
        if self.direction == "conventional":
            start, end = -end, -start
        step = (end - start) / _ANGLES
        angle = start + step * (np.arange(_ANGLES) + 0.5)
        thickness = np.maximum(self.feed_per_tooth / _MILLIMETRE * np.cos(angle), 0.0)
        pressure, exponent = self.material.pressure, self.material.exponent
        cutting = pressure * (self.depth / _MILLIMETRE) * thickness ** (1.0 - exponent)
        sine, cosine = np.sin(angle), np.cos(angle)
        along = np.stack(
            [sine - self.radial * cosine, -cosine - self.radial * sine, np.full(_ANGLES, -self.axial)]
        )
        return np.asarray(self.teeth * step / (2.0 * np.pi) * (along @ cutting))
