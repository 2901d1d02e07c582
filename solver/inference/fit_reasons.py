"""Reasons in the fit itself: what is not identified, not certain, not explained or not plausible."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from typing import Final

import numpy as np

from jointstiff.solver.inference.estimate import Estimate
from jointstiff.solver.inference.plausibility import judge
from jointstiff.solver.inference.prediction import Prediction
from jointstiff.solver.inference.reason import Action, Place, Reason
from jointstiff.solver.readings import Measurements

CARE_RATIO, UNUSABLE_RATIO = 1.5, 3.0
"""Residuals over what sigma allows, by which the uncertainties are too small."""
CARE_LEVEL: Final = 1e-3
"""Probability of larger residuals by chance: few readings exceed `CARE_RATIO` without a mistake."""
CARE_SHARE, UNUSABLE_SHARE = 0.7, 0.5
"""Compensation below which something besides the joints deflects; of real robots they explain 80 %."""
LEAST_SIGMA: Final = 1e-8
"""No tracker reads this well [m]: such residuals are those of computed readings."""
_LEAST_FREEDOM: Final = 0.5


def fit_reasons(measurements: Measurements, estimate: Estimate, prediction: Prediction) -> Iterator[Reason]:
    """Yield the reasons that an estimate and its prediction give."""
    yield from _identified(estimate)
    yield from _freedom(measurements, estimate)
    yield from _residuals(estimate)
    yield from _unexplained(estimate, prediction)
    yield from _from_judge(estimate, prediction)


def within_noise(estimate: Estimate) -> bool:
    """Tell whether the residuals leave nothing for another explanation."""
    test = estimate.sigma_test
    return test is not None and test.verdict != "residuals_too_large"


def _identified(estimate: Estimate) -> Iterator[Reason]:
    if any(joint.status == "identified" for joint in estimate.joints):
        return
    counts = Counter(joint.status.replace("_", " ") for joint in estimate.joints)
    found = ", ".join(f"{count} {status}" for status, count in counts.items())
    yield Reason(
        "no_joint_identified",
        "do_not_use",
        None,
        f"the readings identify no joint: {found}",
        "add postures and loads that twist the joints, or constrain fewer of them",
    )


def _freedom(measurements: Measurements, estimate: Estimate) -> Iterator[Reason]:
    """Report a fit that no reading can contradict; a rigid flange moves by six coordinates at most."""
    coordinates = int(np.minimum(3 * measurements.present.sum(axis=1), 6).sum())
    if measurements.encoders is not None:
        coordinates += int(measurements.encoders.present.sum())
    free = min(estimate.degrees_of_freedom, coordinates - sum(i.rank for i in estimate.identifiability))
    if free < _LEAST_FREEDOM:
        unknown = estimate.sigma is None
        yield Reason(
            "no_residual_freedom",
            "do_not_use" if unknown else "use_with_care",
            None,
            "there are as many parameters as readings, so the fit is exact whatever was measured: "
            + ("no uncertainty is known" if unknown else "only the stated noise says how certain it is"),
            "add observations, at least twice as many as now",
        )
    elif estimate.sigma is not None and not estimate.sigma_given and estimate.sigma < LEAST_SIGMA:
        yield Reason(
            "residuals_vanish",
            "use_with_care",
            None,
            f"by the residuals a reading is certain to {estimate.sigma:.2g} m, and no tracker is: these "
            "readings are computed, not measured, and the uncertainties mean nothing",
            "state `noise` as the tracker's data sheet gives it",
        )


def _residuals(estimate: Estimate) -> Iterator[Reason]:
    """Compare the residuals with a stated sigma."""
    test = estimate.sigma_test
    if test is None or test.verdict != "residuals_too_large" or test.p_value > CARE_LEVEL:
        return
    ratio = float(np.sqrt(estimate.chi_square / estimate.degrees_of_freedom))
    if ratio > CARE_RATIO:
        yield Reason(
            "residuals_exceed_sigma",
            "use_with_care" if ratio <= UNUSABLE_RATIO else "do_not_use",
            None,
            f"the residuals are {ratio:.3g} times what the stated noise allows, so the uncertainties are too "
            "small by as much",
            "check frames, joint map, units and noise; if all are correct, something besides the joints "
            "deflects: omit `noise` so that sigma is estimated from the residuals",
            Action("omit_noise"),
        )


def _unexplained(estimate: Estimate, prediction: Prediction) -> Iterator[Reason]:
    """Report deflections that the joints do not explain and that are not the stated noise either."""
    share = prediction.compensation
    if share is None or share >= CARE_SHARE or within_noise(estimate):
        return
    norm = np.linalg.norm(prediction.residual, axis=2).max(axis=1)
    yield Reason(
        "deflection_unexplained",
        "use_with_care" if share >= UNUSABLE_SHARE else "do_not_use",
        None,
        f"the joints explain {100 * share:.3g} % of the mean deflection; of industrial robots they explain "
        "about 80 %",
        "check the robot's model and joint map, the frame and signs of the forces, and the units",
        Action("show_posture", (int(norm.argmax()),)),
    )


def _from_judge(estimate: Estimate, prediction: Prediction) -> Iterator[Reason]:
    """Turn what the plausibility checks find of single joints and of K_c into reasons."""
    for finding in judge(estimate, prediction):
        where = None if finding.joint is None else Place(joint=finding.joint)
        if finding.code == "stiffness_implausible":
            yield Reason(finding.code, "do_not_use", where, finding.message, finding.remedy)
        elif finding.code == "prior_dominates":
            yield Reason(finding.code, "use_with_care", where, finding.message, finding.remedy)
        elif finding.code == "complementary_stiffness_matters":
            action = Action("include_complementary_stiffness")
            yield Reason(finding.code, "use_with_care", where, finding.message, finding.remedy, action)
