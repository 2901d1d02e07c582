"""Findings about implausible fits, reported with the numbers."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

import numpy as np

from jointstiff.schemas.finding import Action, Finding
from jointstiff.solver.evidence.estimate import Estimate
from jointstiff.solver.evidence.verdict import JointCompliance

CHECK_NOISE: Final = (
    "check frames, joint map, units and noise; if all are correct, something besides the joints deflects: "
    "omit `noise` so that sigma is estimated from the residuals"
)
CHECK_ALL: Final = "check the robot's model, the joint map, the frame and signs of the forces, and the units"
WORTH_A_WARNING: Final = 0.1
"""Relative error of sigma that changes no conclusion; in large sets the test detects even less."""
PLAUSIBLE_STIFFNESS: Final = (1e3, 1e9)
"""Range of joint stiffness of industrial robots [N·m/rad], with a margin of three decades."""
LARGEST_SHIFT: Final = 0.5
"""Bias in standard uncertainties at which a 95 % interval covers only 92 %."""


def judge(estimate: Estimate) -> Iterator[Finding]:
    """Look at the joints and at K_c with the eyes of someone who has seen many robots."""
    yield from _priors(estimate)
    yield from _stiffness(estimate)
    yield from _complementary_stiffness(estimate)


def _priors(estimate: Estimate) -> Iterator[Finding]:
    for joint in estimate.joints:
        ratio = joint.prior_to_data
        if ratio is None or ratio <= 1.0:
            continue
        says = (
            "alone separates it from other joints"
            if np.isinf(ratio)
            else f"carries {ratio:.3g} times as much information as the readings"
        )
        yield Finding(
            code="prior_dominates",
            weight="use_with_care",
            where=joint.name,
            message=f"the prior of {joint.name} {says}: the estimate mainly repeats the data sheet",
            remedy=(
                "add loads and postures with more torque about its axis, or omit the prior to see what was "
                "measured"
            ),
        )


def _stiffness(estimate: Estimate) -> Iterator[Finding]:
    least, greatest = PLAUSIBLE_STIFFNESS
    for joint in estimate.joints:
        if joint.status == "identified" and joint.compliance is not None:
            stiffness = 1.0 / joint.compliance if joint.compliance else np.inf
            if not least <= abs(stiffness) <= greatest:
                yield Finding(
                    code="stiffness_implausible",
                    weight="do_not_use",
                    where=joint.name,
                    message=(
                        f"the stiffness of {joint.name} is {stiffness:.3g} N.m/rad; joints of industrial "
                        f"robots have {least:.0e} to {greatest:.0e} N.m/rad"
                    ),
                    remedy=_implausible_remedy(estimate, joint),
                )


def _implausible_remedy(estimate: Estimate, joint: JointCompliance) -> str:
    """Return the checks: a wrong unit scales all joints, a wrong column or map changes single joints."""
    if (joint.compliance or 0.0) < 0.0:
        return "set non_negative; check the joint map, the order of the angles and the signs of the forces"
    sizes = [abs(j.compliance) for j in estimate.joints if j.status == "identified" and j.compliance]
    least, greatest = (1.0 / bound for bound in reversed(PLAUSIBLE_STIFFNESS))
    if all(not least <= size <= greatest for size in sizes):
        return "check the units of force, length and moment: all joints are out of range"
    return (
        f"check the angles and the joint map of {joint.name} and its neighbours; the other joints "
        "are plausible"
    )


def _complementary_stiffness(estimate: Estimate) -> Iterator[Finding]:
    size = estimate.complementary_stiffness
    if size is not None and size.obstacle is not None:
        yield Finding(
            code="complementary_stiffness_matters",
            weight="use_with_care",
            message=f"the complementary stiffness K_c had to be neglected: {size.obstacle}",
            remedy="check the units of force and length",
        )
        return
    if size is None or size.included or size.largest_shift is None or size.largest_shift <= LARGEST_SHIFT:
        return
    yield Finding(
        code="complementary_stiffness_matters",
        weight="use_with_care",
        message=(
            "neglecting the complementary stiffness K_c biases a compliance by "
            f"{size.largest_shift:.2g} standard uncertainties"
        ),
        remedy="set complementary_stiffness: included",
        action=Action.of("include_complementary_stiffness"),
    )
