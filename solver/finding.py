"""A suspicion: said with figures, never mended silently."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

__all__ = ["Finding", "FindingCode", "length_text"]

FindingCode = Literal[
    "targets_not_rigid",
    "target_off_model",
    "target_name_suspect",
    "deflection_against_force",
    "joint_outside_limits",
    "angle_unit_suspect",
    "deflection_implausibly_large",
    "deflection_implausibly_small",
    "deflection_below_noise",
    "sigma_suspect",
    "zero_load",
    "residuals_exceed_sigma",
    "low_compensation",
    "stiffness_implausible",
]


@dataclass(frozen=True)
class Finding:
    """One suspicion.

    Attributes:
        code: its kind.
        observation: index of the observation; None for the whole set.
        message: what was seen, with figure and unit.
        remedy: what to check.
    """

    code: FindingCode
    observation: int | None
    message: str
    remedy: str


def length_text(length: float) -> str:
    """A length [m] for people, in the unit that suits it."""
    for factor, unit in ((1.0, "m"), (1e3, "mm"), (1e6, "µm")):
        if abs(length) * factor >= 1.0:
            return f"{length * factor:.3g} {unit}"
    return f"{length * 1e9:.3g} nm"
