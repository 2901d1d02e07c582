"""Warnings about implausible fits, reported with the numbers."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

import numpy as np

from jointstiff.solver.finding import Finding
from jointstiff.solver.inference.estimate import Estimate
from jointstiff.solver.inference.prediction import Prediction
from jointstiff.solver.inference.verdict import JointCompliance

CHECK_NOISE: Final = (
    "check frames, joint map, units and noise; if all are correct, something besides the joints deflects: "
    "omit `noise` so that sigma is estimated from the residuals"
)
CHECK_ALL: Final = "check the robot's model, the joint map, the frame and signs of the forces, and the units"
WORTH_A_WARNING: Final = 0.1
"""Relative error of sigma that changes no conclusion; in large sets the test detects even less."""
LEAST_COMPENSATION: Final = 0.5
"""Least compensation: joints usually explain 80 % of the deflection, in the paper's worst method 50 %."""
PLAUSIBLE_STIFFNESS: Final = (1e3, 1e9)
"""Range of joint stiffness of industrial robots [N·m/rad], with a margin of three decades."""
LARGEST_SHIFT: Final = 0.5
"""Bias in standard uncertainties at which a 95 % interval covers only 92 %."""


def judge(estimate: Estimate, prediction: Prediction) -> list[Finding]:
    """Look at a fit with the eyes of someone who has seen many robots."""
    return [
        *_sigma(estimate),
        *_priors(estimate),
        *_compensation(prediction),
        *_stiffness(estimate),
        *_complementary_stiffness(estimate),
    ]


def _sigma(estimate: Estimate) -> Iterator[Finding]:
    """A stated sigma that the chi-square test rejects."""
    test = estimate.sigma_test
    if test is None or test.verdict == "consistent":
        return
    ratio = float(np.sqrt(estimate.chi_square / estimate.degrees_of_freedom))
    if abs(ratio - 1.0) < WORTH_A_WARNING:
        return
    if test.verdict == "residuals_too_small":
        yield Finding(
            "sigma_overstated",
            None,
            f"the residuals are only {ratio:.3g} times as large as sigma predicts (chi-square test, "
            f"{_p_value(test.p_value)}), so the uncertainties are too large",
            "check `noise` and `units.length`; omit `noise` so that sigma is estimated from the residuals",
        )
    else:
        yield Finding(
            "residuals_exceed_sigma",
            None,
            f"the residuals are {ratio:.3g} times as large as sigma predicts (chi-square test, "
            f"{_p_value(test.p_value)}), so the uncertainties are too small by the same factor",
            CHECK_NOISE,
        )


def _p_value(p: float) -> str:
    """A p value as people read it; one that underflows is not zero."""
    return "p < 0.001" if p < 0.001 else f"p = {p:.1g}"


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
            "prior_dominates",
            None,
            f"the prior of {joint.name} {says}: the estimate mainly repeats the data sheet",
            "add loads and postures with more torque about its axis, or omit the prior to see what was "
            "measured",
            joint=joint.name,
        )


def _compensation(prediction: Prediction) -> Iterator[Finding]:
    share = prediction.compensation
    if share is not None and share < LEAST_COMPENSATION:
        yield Finding(
            "low_compensation",
            None,
            f"the joints explain only {100 * share:.3g} % of the mean deflection",
            CHECK_ALL,
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
                    f"the stiffness of {joint.name} is {stiffness:.3g} N.m/rad; joints of industrial robots "
                    f"have {least:.0e} to {greatest:.0e} N.m/rad",
                    _implausible_remedy(estimate, joint),
                    joint=joint.name,
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
            "complementary_stiffness_matters",
            None,
            f"the complementary stiffness K_c had to be neglected: {size.obstacle}",
            "check the units of force and length",
        )
        return
    if size is None or size.included or size.largest_shift is None or size.largest_shift <= LARGEST_SHIFT:
        return
    yield Finding(
        "complementary_stiffness_matters",
        None,
        "neglecting the complementary stiffness K_c biases a compliance by "
        f"{size.largest_shift:.2g} standard uncertainties",
        "set complementary_stiffness: included",
    )
