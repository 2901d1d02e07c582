"""Findings on the fit of a sweep."""

from __future__ import annotations

import numpy as np
from scipy import special

from jointstiff.schemas.finding import Finding
from jointstiff.solver.geometry.sweeps.anomaly import Anomaly, find_anomalies
from jointstiff.solver.geometry.sweeps.circle_point import AxisFit
from jointstiff.solver.geometry.sweeps.swept_axes import SweptAxes
from jointstiff.solver.text import length_text

SHORT_ARC = np.radians(30.0)
"""Arc [rad] below which an axis gets a warning: its centre is then ten times as uncertain along the
sagitta as over a half turn."""

BEYOND_MODEL = 3.0
"""Displacement by a bump over a typical residual of all sweeps: less may be the model or a gear."""

_CHI_SQUARE_ALARM = 1e-6
_UNEVEN = 0.01
_SCALE_ALARM = 1e-3  # controller and tracker disagree by 0.1 % of the arc


def geometry_findings(identified: SweptAxes, whole: SweptAxes) -> tuple[Finding, ...]:
    """Return the findings of all sweeps.

    Args:
        identified: axes of the sweeps, fitted one by one.
        whole: the fit of all sweeps, whose residuals show how well the robot is its model.
    """
    typical = float(np.median([fit.rss / fit.dof for fit in identified.fits]))
    least = BEYOND_MODEL * whole.robust_sigma
    return tuple(
        finding
        for fit in identified.fits
        for finding in sweep_findings(fit, identified.names, typical=typical, least=least)
    )


def sweep_findings(
    fit: AxisFit, names: tuple[str, ...], *, typical: float = 0.0, least: float = 0.0
) -> tuple[Finding, ...]:
    """Return suspicions about one sweep; none about a clean one.

    Args:
        fit: the sweep, fitted by itself.
        names: of the targets.
        typical: variance of a residual in the sweeps beside it; what does not stand out from that is no
            anomaly of this one.
        least: displacement [m] below which a bump is none.
    """
    anomalies = find_anomalies(fit.linear, fit.sweep, typical)
    findings = [
        _anomaly(fit, anomaly, names)
        for anomaly in anomalies
        if anomaly.kind != "bump" or float(np.linalg.norm(anomaly.displacement)) >= least
    ]
    if fit.arc < SHORT_ARC:
        spread = float(np.sqrt(np.linalg.eigvalsh(fit.axis_covariance[:2, :2]).max()))
        findings.append(
            Finding(
                code="short_arc",
                weight="use_with_care",
                where=fit.sweep.where,
                message=(
                    f"an arc of {np.degrees(fit.arc):.3g}° determines the axis only within "
                    f"{length_text(spread)}"
                ),
                remedy="sweep at least 90°",
            )
        )
    findings += _variance(fit)
    if abs(fit.angle_scale - 1.0) > _SCALE_ALARM:
        findings.append(
            Finding(
                code="angle_scale_suspect",
                weight="do_not_use",
                where=fit.sweep.where,
                message=(
                    f"the joint turned {fit.angle_scale:.4f} times as far as the controller's angles and the "
                    "joint map give"
                ),
                remedy="check the joint map, the unit of the angles, and the order of the rows",
            )
        )
    return tuple(findings)


def angle_probability(free: SweptAxes, controller: SweptAxes) -> float:
    """Probability that noise alone makes the controller's angles fit as badly as they do.

    F-test of the fit with the controller's angles inside the one with free angles. Where it is not small,
    `angles="controller"` is justified by the readings, and the better estimate.
    """
    more = controller.dof - free.dof
    if more < 1:
        return 1.0
    gain = max(controller.rss - free.rss, 0.0) / more
    return float(special.fdtrc(more, free.dof, gain / (free.rss / free.dof)))


def uneven(probability: float) -> bool:
    """Return whether gears are off by more than noise, by the probability of the controller's angles."""
    return probability < _UNEVEN


def disagree(probability: float | None) -> bool:
    """Return whether one robot does not fit all sweeps, by the probability of the test."""
    return probability is not None and probability < _CHI_SQUARE_ALARM


def agreement_findings(probability: float | None) -> tuple[Finding, ...]:
    """Report sweeps that no single robot model fits, by the p-value of one model for all.

    Args:
        probability: of the F-test of the fit of all sweeps inside the fits one by one; None if there is none.
    """
    if probability is None or not disagree(probability):
        return ()
    return (
        Finding(
            code="sweeps_disagree",
            weight="use_with_care",
            where="sweeps",
            message=(
                "joints at rest were not where the controller shows them, or the arm sagged: no single robot "
                f"fits all sweeps (p = {probability:.1g}), so the axes are those of the sweeps fitted one "
                "by one"
            ),
            remedy=(
                "use the result with its larger uncertainties; for smaller ones, rest all joints at the same "
                "angles in all sweeps, approached from the same side"
            ),
        ),
    )


def _anomaly(fit: AxisFit, anomaly: Anomaly, names: tuple[str, ...]) -> Finding:
    size = float(np.linalg.norm(anomaly.displacement))
    place = f"{fit.sweep.where}, position {anomaly.position + 1}"
    chance = f"(p = {anomaly.probability:.1g})"
    if anomaly.kind == "bump":
        return Finding(
            code="tracker_bumped",
            weight="do_not_use",
            where=place,
            message=(
                f"from this position on, all readings are displaced by about {length_text(size)} {chance}: "
                "the tracker or the robot's base was bumped"
            ),
            remedy="repeat the sweep, or omit the positions before or after the bump",
        )
    if anomaly.kind == "position":
        return Finding(
            code="position_suspect",
            weight="use_with_care",
            where=place,
            message=f"all targets are displaced by about {length_text(size)} {chance}",
            remedy=(
                "the robot may not have come to rest, or the angles belong to another position: omit the "
                "position"
            ),
        )
    target = names[anomaly.target] if anomaly.target is not None else ""
    return Finding(
        code="reading_suspect",
        weight="use_with_care",
        where=f"{place}, target {target}",
        message=f"this reading is displaced by about {length_text(size)} {chance}",
        remedy="omit or repeat the reading",
    )


def _variance(fit: AxisFit) -> list[Finding]:
    if not fit.sigma_stated:
        return []
    rms = length_text(float(np.sqrt(fit.rss / fit.dof)))
    sigma = length_text(fit.sigma)
    if special.chdtrc(fit.dof, fit.rss / fit.sigma**2) < _CHI_SQUARE_ALARM:
        return [
            Finding(
                code="residuals_exceed_sigma",
                weight="use_with_care",
                where=fit.sweep.where,
                message=(
                    f"the residuals give sigma = {rms}, but {sigma} was stated: the uncertainties are too "
                    "small"
                ),
                remedy="correct or omit sigma; poor repeatability of the robot has the same effect",
            )
        ]
    if special.chdtr(fit.dof, fit.rss / fit.sigma**2) < _CHI_SQUARE_ALARM:
        return [
            Finding(
                code="residuals_below_sigma",
                weight="use",
                where=fit.sweep.where,
                message=(
                    f"the residuals give sigma = {rms}, but {sigma} was stated: the uncertainties are too "
                    "large"
                ),
                remedy="check the unit of sigma",
            )
        ]
    return []
