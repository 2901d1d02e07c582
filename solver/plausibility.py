"""What is suspicious in a fit: said beside its numbers, so that no one trusts them unwarned."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

import numpy as np

from solver.estimate import Estimate
from solver.finding import Finding
from solver.prediction import Prediction

__all__ = ["judge"]

LARGEST_CHI_SQUARE_RATIO: Final = 4.0
"""χ² per degree of freedom above which uncertainties are too small by a factor of two or more."""
LEAST_COMPENSATION: Final = 0.5
"""Joints usually explain four fifths of the deflection; the paper's worst method explained half."""
PLAUSIBLE_STIFFNESS: Final = (1e3, 1e9)
"""Of an industrial robot's joint [N·m/rad], with three decades to spare."""


def judge(estimate: Estimate, prediction: Prediction) -> list[Finding]:
    """Look at a fit with the eyes of someone who has seen many robots.

    Args:
        estimate: of the joints.
        prediction: by that estimate, of the same measurements.

    Returns:
        The findings, none of them bound to an observation.
    """
    return [*_residuals(estimate), *_compensation(prediction), *_stiffness(estimate)]


def _residuals(estimate: Estimate) -> Iterator[Finding]:
    if not estimate.sigma_given or estimate.degrees_of_freedom < 1:
        return
    ratio = estimate.chi_square / estimate.degrees_of_freedom
    if ratio > LARGEST_CHI_SQUARE_RATIO:
        yield Finding(
            "residuals_exceed_sigma",
            None,
            f"the residuals are {np.sqrt(ratio):.3g} times what sigma allows (χ²/dof {ratio:.3g}), so the "
            "uncertainties are too small by as much",
            "check frames, joint map, units and sigma; if all are right something else than joints bends: "
            "leave noise out, and sigma comes from the residuals",
        )


def _compensation(prediction: Prediction) -> Iterator[Finding]:
    share = prediction.compensation
    if share is not None and share < LEAST_COMPENSATION:
        yield Finding(
            "low_compensation",
            None,
            f"the joints explain {100 * share:.3g} % of the mean deflection",
            "check the robot's model and joint map, the frame and signs of the forces, and the units",
        )


def _stiffness(estimate: Estimate) -> Iterator[Finding]:
    least, greatest = PLAUSIBLE_STIFFNESS
    for joint in estimate.joints:
        if joint.status == "identified" and joint.compliance is not None:
            stiffness = 1.0 / joint.compliance if joint.compliance else np.inf
            if not least <= abs(stiffness) <= greatest:
                yield Finding(
                    "stiffness_implausible",
                    None,
                    f"{joint.name} comes out at {stiffness:.3g} N.m/rad",
                    "check the units of force, length and moment",
                )
