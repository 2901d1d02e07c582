"""Reasons in the fit itself: what is not identified, not certain, not explained or not plausible."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from typing import Final

import numpy as np

from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.finding import length_text
from jointstiff.solver.inference.estimate import Estimate
from jointstiff.solver.inference.plausibility import CHECK_ALL, CHECK_NOISE, WORTH_A_WARNING, judge
from jointstiff.solver.inference.prediction import Prediction
from jointstiff.solver.inference.reason import Action, Place, Reason
from jointstiff.solver.inference.screening import HeldOutGain, Screening
from jointstiff.solver.readings.measurements import Measurements

CARE_RATIO_OF_LINKS, UNUSABLE_RATIO = 1.5, 3.0
"""Ratio of the residuals to sigma above which the uncertainties are too small: of a model with links, whose
penalty leaves some of it and whose joints are not to be quoted; and above which they are of no use."""
CARE_LEVEL: Final = 1e-3
"""p-value of the residuals below which the uncertainties are too small: noise alone reaches it in one of two
thousand campaigns."""
CARE_SHARE, UNUSABLE_SHARE = 0.7, 0.5
"""Compensation below which something besides the joints deflects; the joints of real robots explain 80 %."""
LARGEST_SIGMA: Final = 1e-4
"""Sigma from the residuals [m] that no laser tracker has: readings of a robot have 10 to 40 µm."""
LEAST_SIGMA: Final = 1e-8
"""Residuals [m] below which the readings are computed, not measured."""
_LEAST_FREEDOM: Final = 0.5
_LEAST_POSTURES: Final = 3
_DISTINCT: Final = float(np.radians(5.0))
"""Difference of a joint's angle [rad] that makes a posture another one."""


def fit_reasons(
    measurements: Measurements,
    estimate: Estimate,
    prediction: Prediction,
    screening: Screening | None = None,
    *,
    explained: bool = False,
) -> Iterator[Reason]:
    """Yield the reasons that an estimate and its prediction give.

    Args:
        measurements: N observations.
        estimate: from these measurements.
        prediction: by that estimate.
        screening: of these measurements; None without one.
        explained: whether another reason already explains the deflections.
    """
    yield from _identified(estimate)
    yield from _freedom(measurements, estimate)
    yield from _postures(measurements)
    yield from _refuted(measurements, estimate)
    yield from _residuals(estimate, joints_alone=prediction.contributions is not None)
    if not explained:
        yield from _unexplained(estimate, prediction)
    yield from _from_judge(estimate, prediction)
    yield from _links(prediction, screening)


def within_noise(estimate: Estimate) -> bool:
    """Tell whether the residuals leave nothing for another explanation."""
    test = estimate.sigma_test
    return test is not None and test.verdict != "residuals_too_large"


def unidentified(statuses: Sequence[str], remedy: str, action: Action | None = None) -> Iterator[Reason]:
    """Yield the reason that no joint is identified, if none is."""
    if "identified" in statuses:
        return
    counts = Counter(status.replace("_", " ") for status in statuses)
    found = ", ".join(f"{count} {status}" for status, count in counts.items())
    message = f"the readings identify no joint: {found}"
    yield Reason("no_joint_identified", "do_not_use", None, message, remedy, action)


def _identified(estimate: Estimate) -> Iterator[Reason]:
    statuses = [joint.status for joint in estimate.joints]
    seen = [status for status in statuses if status != "not_observable"]
    opposed = bool(seen) and all(status == "at_bound" for status in seen)
    yield from unidentified(
        statuses,
        "check signs, frame and units of forces and deflections, and the joint map: the targets do not move "
        "as these loads would move them"
        if opposed
        else "add postures and loads that twist the joints",
        Action("exchange_readings") if opposed else None,
    )


def _freedom(measurements: Measurements, estimate: Estimate) -> Iterator[Reason]:
    """Report a fit that no reading can contradict; a rigid flange moves by six coordinates at most."""
    coordinates = int(np.minimum(measurements.coordinates.sum(axis=1), 6).sum())
    if measurements.encoders is not None:
        coordinates += int(measurements.encoders.present.sum())
    free = min(estimate.degrees_of_freedom, coordinates - sum(i.rank for i in estimate.identifiability))
    if free < _LEAST_FREEDOM:
        unknown = not estimate.sigma_given
        yield Reason(
            "no_residual_freedom",
            "do_not_use" if unknown else "use_with_care",
            None,
            "there are as many parameters as readings, so the fit is exact whatever was measured: "
            + (
                "the uncertainty is unknown"
                if unknown
                else "its uncertainty comes from the stated noise only"
            ),
            "add observations: at least twice the present number",
        )
    elif estimate.sigma is not None and not estimate.sigma_given and estimate.sigma < LEAST_SIGMA:
        yield Reason(
            "residuals_vanish",
            "use_with_care",
            None,
            f"the residuals give a standard uncertainty of {estimate.sigma:.2g} m per reading, which "
            "no tracker reaches: these readings are computed, not measured, and the uncertainties are "
            "meaningless",
            "state `noise` from the tracker's data sheet",
        )
    elif estimate.sigma is not None and not estimate.sigma_given and estimate.sigma > LARGEST_SIGMA:
        yield Reason(
            "sigma_implausible",
            "use_with_care",
            None,
            f"the residuals give a standard uncertainty of {length_text(estimate.sigma)} per coordinate of a "
            "reading; laser trackers have 10 to 40 µm, so most of it is what the model leaves unexplained",
            "state `noise` from the instrument's data sheet; check geometry, angles and loads, and whether "
            "links bend",
        )


def _postures(measurements: Measurements) -> Iterator[Reason]:
    """Report postures so few that no reading shows whether the stiffnesses hold elsewhere."""
    postures: list[FloatArray] = []
    for joints in measurements.joints:
        if all(np.abs(joints - other).max() >= _DISTINCT for other in postures):
            postures.append(joints)
        if len(postures) >= _LEAST_POSTURES:
            return
    yield Reason(
        "few_postures",
        "use_with_care",
        None,
        f"{len(postures)} distinct posture{'s' if len(postures) > 1 else ''}: the stiffnesses were not "
        "tested in others",
        f"measure at least {_LEAST_POSTURES} postures that differ by {np.degrees(_DISTINCT):.0f}° or more",
    )


def _residuals(estimate: Estimate, *, joints_alone: bool) -> Iterator[Reason]:
    """Compare the residuals with a stated sigma."""
    test = estimate.sigma_test
    if test is None or test.verdict != "residuals_too_large" or test.p_value > CARE_LEVEL:
        return
    ratio = float(np.sqrt(estimate.chi_square / estimate.degrees_of_freedom))
    if ratio > (1.0 + WORTH_A_WARNING if joints_alone else CARE_RATIO_OF_LINKS):
        yield Reason(
            "residuals_exceed_sigma",
            "use_with_care" if ratio <= UNUSABLE_RATIO else "do_not_use",
            None,
            f"the residuals are {ratio:.3g} times as large as the stated noise allows, so the "
            "uncertainties are too small by the same factor",
            CHECK_NOISE,
            Action("omit_noise"),
        )


def _refuted(measurements: Measurements, estimate: Estimate) -> Iterator[Reason]:
    """Report a stated sigma that the residuals refuted: taken from them, it hides what the model lacks."""
    refuted = measurements.refuted_sigma
    if refuted is None or estimate.sigma is None:
        return
    yield Reason(
        "residuals_exceed_sigma",
        "use_with_care",
        None,
        f"the residuals give a standard uncertainty of {length_text(estimate.sigma)} per coordinate of a "
        f"reading, {estimate.sigma / refuted:.3g} times the {length_text(refuted)} that were stated and that "
        "they refuted: what the model leaves unexplained counts as noise, and may be no noise",
        CHECK_NOISE,
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
        f"the joints explain only {100 * share:.3g} % of the mean deflection; those of industrial "
        "robots explain about 80 %",
        CHECK_ALL,
        Action("show_posture", (int(norm.argmax()),)),
    )


def _links(prediction: Prediction, screening: Screening | None) -> Iterator[Reason]:
    """Report that joints and links share what bends (method.md §7), or that joints alone lack something."""
    gain = None if screening is None else screening.gain
    if prediction.contributions is None:
        evidence = "" if screening is None or gain is None else f"{_bends(screening)}. {_predicted(gain)}. "
        yield Reason(
            "links_bend_with_joints",
            "use_with_care",
            None,
            f"{evidence}Each joint's stiffness includes some bending of its link; the bias exceeds the "
            "stated uncertainty. Predicted deflections are not affected",
            "use the model to predict deflections; do not quote the stiffness of a single joint, as "
            "readings under load cannot separate a joint from its link",
        )
    elif screening is not None and screening.lack_of_fit:
        predicted = "" if gain is None else f". {_predicted(gain)}"
        yield Reason(
            "lack_of_fit",
            "use_with_care",
            None,
            f"{_bends(screening)}{predicted}",
            "let the readings choose the model (elasticity automatic), or use these stiffnesses, of joints "
            "and links together, for postures and loads like these only",
            Action("choose_model") if gain is None and screening.comparable else None,
        )


def _bends(screening: Screening) -> str:
    return f"something besides the joints bends (F test, p = {screening.links_p_value:.1g})"


def _predicted(gain: HeldOutGain) -> str:
    return (
        f"With {gain.model.replace('_', ' ')}, held-out postures are predicted to "
        f"{length_text(gain.error)}, by joints alone to {length_text(gain.error_of_joints)}"
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
            size = estimate.complementary_stiffness
            able = size is not None and size.obstacle is None
            action = Action("include_complementary_stiffness") if able else None
            yield Reason(finding.code, "use_with_care", where, finding.message, finding.remedy, action)
