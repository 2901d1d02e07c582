"""A suspicion: said with figures, never mended silently."""

from __future__ import annotations

from dataclasses import dataclass
from math import floor, log10
from typing import Final, Literal

Severity = Literal["error", "warning", "note"]

FindingCode = Literal[
    "targets_not_rigid",
    "target_moved",
    "targets_swapped",
    "target_off_model",
    "observations_out_of_order",
    "duplicated_observation",
    "joint_sign_suspect",
    "joints_swapped",
    "length_unit_suspect",
    "force_unit_suspect",
    "force_sign_suspect",
    "drift_in_time",
    "repeated_readings",
    "residual_outlier",
    "deflections_unexplained",
    "target_name_suspect",
    "deflection_against_force",
    "encoder_against_torque",
    "encoder_deflection_implausibly_large",
    "joint_outside_limits",
    "angle_unit_suspect",
    "deflection_implausibly_large",
    "deflection_implausibly_small",
    "deflection_below_noise",
    "sigma_suspect",
    "zero_load",
    "residuals_exceed_sigma",
    "sigma_overstated",
    "prior_dominates",
    "low_compensation",
    "stiffness_implausible",
    "complementary_stiffness_matters",
    "base_drifted",
    "base_target_moved",
    "link_penalty_at_end",
    "link_penalty_raised",
    "loss_not_compared",
]

MM_AS_M: Final = "the lengths seem to be in mm and declared as m: set `units.length` to mm"
M_AS_MM: Final = "the lengths seem to be in m and declared as mm: set `units.length` to m"
NOISE_SIGMAS: Final = 3.0
"""Number of standard deviations below which a deflection carries little information."""


@dataclass(frozen=True)
class Finding:
    """One suspicion."""

    code: FindingCode  #: kind of finding
    observation: int | None  #: index of the observation; None for the whole set
    message: str  #: observed effect, with figure and unit
    remedy: str  #: checks to make
    #: "error" where it is almost certainly a mistake, "note" where it is good to know
    severity: Severity = "warning"
    joint: str | None = None  #: name of the joint; None where it is about no single one


def length_text(length: float) -> str:
    """A length [m] for people, in the unit that suits it."""
    for factor, unit in ((1.0, "m"), (1e3, "mm"), (1e6, "µm")):
        if abs(length) * factor >= 1.0:
            return f"{length * factor:.3g} {unit}"
    return f"{length * 1e9:.3g} nm"


def rounded_down(limit: float) -> float:
    """Round a lower limit down to three digits."""
    step = 10.0 ** (floor(log10(limit)) - 2)
    return floor(limit / step) * step
