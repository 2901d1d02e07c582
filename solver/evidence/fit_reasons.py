"""Reasons in the fit itself: what is not identified, not certain, not explained or not plausible."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from typing import Final

import numpy as np

from jointstiff.schemas.finding import Action, Finding, Verdict
from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.evidence.estimate import Estimate
from jointstiff.solver.evidence.plausibility import CHECK_ALL, CHECK_NOISE, WORTH_A_WARNING, judge
from jointstiff.solver.evidence.prediction import Prediction
from jointstiff.solver.evidence.screening import HeldOutGain, Screening
from jointstiff.solver.readings.measurements import Measurements
from jointstiff.solver.text import length_text

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
) -> Iterator[Finding]:
    """Yield what an estimate and its prediction show; what forbids nothing has the weight `use`.

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
        yield from _unexplained(measurements, estimate, prediction)
    yield from judge(estimate)
    yield from _links(prediction, screening)


def within_noise(estimate: Estimate) -> bool:
    """Tell whether the residuals leave nothing for another explanation."""
    test = estimate.sigma_test
    return test is not None and test.verdict != "residuals_too_large"


def unidentified(statuses: Sequence[str], remedy: str, action: Action | None = None) -> Iterator[Finding]:
    """Yield the reason that no joint is identified, if none is."""
    if "identified" in statuses:
        return
    counts = Counter(status.replace("_", " ") for status in statuses)
    found = ", ".join(f"{count} {status}" for status, count in counts.items())
    message = f"the readings identify no joint: {found}"
    yield Finding(
        code="no_joint_identified",
        weight="do_not_use",
        message=message,
        remedy=remedy,
        action=action,
    )


def _identified(estimate: Estimate) -> Iterator[Finding]:
    statuses = [joint.status for joint in estimate.joints]
    seen = [status for status in statuses if status != "not_observable"]
    opposed = bool(seen) and all(status == "at_bound" for status in seen)
    yield from unidentified(
        statuses,
        "check signs, frame and units of forces and deflections, and the joint map: the targets do not move "
        "as these loads would move them"
        if opposed
        else "add postures and loads that twist the joints",
        Action.of("exchange_readings") if opposed else None,
    )


def _freedom(measurements: Measurements, estimate: Estimate) -> Iterator[Finding]:
    """Report a fit that no reading can contradict; a rigid flange moves by six coordinates at most."""
    coordinates = int(np.minimum(measurements.coordinates.sum(axis=1), 6).sum())
    if measurements.encoders is not None:
        coordinates += int(measurements.encoders.present.sum())
    free = min(estimate.degrees_of_freedom, coordinates - sum(i.rank for i in estimate.identifiability))
    if free < _LEAST_FREEDOM:
        unknown = not estimate.sigma_given
        yield Finding(
            code="no_residual_freedom",
            weight="do_not_use" if unknown else "use_with_care",
            message=(
                "there are as many parameters as readings, so the fit is exact whatever was measured: "
                + (
                    "the uncertainty is unknown"
                    if unknown
                    else "its uncertainty comes from the stated noise only"
                )
            ),
            remedy="add observations: at least twice the present number",
        )
    elif estimate.sigma is not None and not estimate.sigma_given and estimate.sigma < LEAST_SIGMA:
        yield Finding(
            code="residuals_vanish",
            weight="use_with_care",
            message=(
                f"the residuals give a standard uncertainty of {estimate.sigma:.2g} m per reading, which "
                "no tracker reaches: these readings are computed, not measured, and the uncertainties are "
                "meaningless"
            ),
            remedy="state `noise` from the tracker's data sheet",
        )
    elif estimate.sigma is not None and not estimate.sigma_given and estimate.sigma > LARGEST_SIGMA:
        yield Finding(
            code="sigma_implausible",
            weight="use_with_care",
            message=(
                f"the residuals give a standard uncertainty of {length_text(estimate.sigma)} per "
                "coordinate of a "
                "reading; laser trackers have 10 to 40 µm, so most of it is what the model leaves unexplained"
            ),
            remedy=(
                "state `noise` from the instrument's data sheet; check geometry, angles and loads, and "
                "whether "
                "links bend"
            ),
        )


def _postures(measurements: Measurements) -> Iterator[Finding]:
    """Report postures so few that no reading shows whether the stiffnesses hold elsewhere."""
    postures: list[FloatArray] = []
    for joints in measurements.joints:
        if all(np.abs(joints - other).max() >= _DISTINCT for other in postures):
            postures.append(joints)
        if len(postures) >= _LEAST_POSTURES:
            return
    yield Finding(
        code="few_postures",
        weight="use_with_care",
        message=(
            f"{len(postures)} distinct posture{'s' if len(postures) > 1 else ''}: the stiffnesses were not "
            "tested in others"
        ),
        remedy=(
            f"measure at least {_LEAST_POSTURES} postures that differ by {np.degrees(_DISTINCT):.0f}° or more"
        ),
    )


def _residuals(estimate: Estimate, *, joints_alone: bool) -> Iterator[Finding]:
    """Compare the residuals with a stated sigma, by its chi-square test."""
    test = estimate.sigma_test
    if test is None or test.verdict == "consistent":
        return
    ratio = float(np.sqrt(estimate.chi_square / estimate.degrees_of_freedom))
    if abs(ratio - 1.0) < WORTH_A_WARNING:
        return
    if test.verdict == "residuals_too_small":
        chance = "p < 0.001" if test.p_value < 0.001 else f"p = {test.p_value:.1g}"
        yield Finding(
            code="sigma_overstated",
            weight="use",
            message=(
                f"the residuals are only {ratio:.3g} times as large as sigma predicts (chi-square test, "
                f"{chance}), so the uncertainties are too large"
            ),
            remedy=(
                "check `noise` and `units.length`; omit `noise` so that sigma is estimated from the residuals"
            ),
        )
        return
    weight: Verdict = "use_with_care" if ratio <= UNUSABLE_RATIO else "do_not_use"
    if test.p_value > CARE_LEVEL or (not joints_alone and ratio <= CARE_RATIO_OF_LINKS):
        weight = "use"  # chance, or the penalty of the links, may do it
    yield Finding(
        code="residuals_exceed_sigma",
        weight=weight,
        message=(
            f"the residuals are {ratio:.3g} times as large as the stated noise allows, so the "
            "uncertainties are too small by the same factor"
        ),
        remedy=CHECK_NOISE,
        action=Action.of("omit_noise"),
    )


def _refuted(measurements: Measurements, estimate: Estimate) -> Iterator[Finding]:
    """Report a stated sigma that the residuals refuted: taken from them, it hides what the model lacks."""
    refuted = measurements.refuted_sigma
    if refuted is None or estimate.sigma is None:
        return
    yield Finding(
        code="residuals_exceed_sigma",
        weight="use_with_care",
        message=(
            f"the residuals give a standard uncertainty of {length_text(estimate.sigma)} per coordinate of a "
            f"reading, {estimate.sigma / refuted:.3g} times the {length_text(refuted)} that were stated and "
            "that they refuted: what the model leaves unexplained counts as noise, and may be no noise"
        ),
        remedy=CHECK_NOISE,
    )


def _unexplained(measurements: Measurements, estimate: Estimate, prediction: Prediction) -> Iterator[Finding]:
    """Report deflections that the joints do not explain; for information where the stated noise does."""
    share, noisy = prediction.compensation, within_noise(estimate)
    if share is None or share >= (UNUSABLE_SHARE if noisy else CARE_SHARE):
        return
    weight: Verdict = "use_with_care" if share >= UNUSABLE_SHARE else "do_not_use"
    norm = np.linalg.norm(prediction.residual, axis=2).max(axis=1)
    yield Finding(
        code="deflection_unexplained",
        weight="use" if noisy else weight,
        message=(
            f"the joints explain only {100 * share:.3g} % of the mean deflection; those of industrial "
            "robots explain about 80 %"
        ),
        remedy=CHECK_ALL,
        action=Action.of("show_posture", [measurements.labels[norm.argmax()]]),
    )


def _links(prediction: Prediction, screening: Screening | None) -> Iterator[Finding]:
    """Report that joints and links share what bends (method.md §7), or that joints alone lack something."""
    gain = None if screening is None else screening.gain
    if prediction.contributions is None:
        evidence = "" if screening is None or gain is None else f"{_bends(screening)}. {_predicted(gain)}. "
        yield Finding(
            code="links_bend_with_joints",
            weight="use_with_care",
            message=(
                f"{evidence}Each joint's stiffness includes some bending of its link; the bias exceeds the "
                "stated uncertainty. Predicted deflections are not affected"
            ),
            remedy=(
                "use the model to predict deflections; do not quote the stiffness of a single joint, as "
                "readings under load cannot separate a joint from its link"
            ),
        )
    elif screening is not None and screening.lack_of_fit:
        predicted = "" if gain is None else f". {_predicted(gain)}"
        yield Finding(
            code="lack_of_fit",
            weight="use_with_care",
            message=f"{_bends(screening)}{predicted}",
            remedy=(
                "let the readings choose the model (elasticity automatic), or use these stiffnesses, of "
                "joints "
                "and links together, for postures and loads like these only"
            ),
            action=Action.of("choose_model") if gain is None and screening.comparable else None,
        )


def _bends(screening: Screening) -> str:
    return f"something besides the joints bends (F test, p = {screening.links_p_value:.1g})"


def _predicted(gain: HeldOutGain) -> str:
    return (
        f"With {gain.model.replace('_', ' ')}, held-out postures are predicted to "
        f"{length_text(gain.error)}, by joints alone to {length_text(gain.error_of_joints)}"
    )
