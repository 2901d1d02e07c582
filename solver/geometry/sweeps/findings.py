"""What a metrologist would say about the fit of a sweep."""

from __future__ import annotations

import numpy as np
from scipy import stats

from jointstiff.solver.finding import length_text
from jointstiff.solver.geometry.finding import GeometryFinding
from jointstiff.solver.geometry.sweeps.anomaly import Anomaly, find_anomalies
from jointstiff.solver.geometry.sweeps.circle_point import AxisFit
from jointstiff.solver.geometry.sweeps.coupled_sweep import CoupledFit
from jointstiff.solver.geometry.sweeps.swept_axes import SweptAxes

SHORT_ARC = np.radians(30.0)
"""Arc [rad] below which an axis is worth a warning: its centre is then ten times as uncertain along the
sagitta as over a half turn."""

_CHI_SQUARE_ALARM = 1e-6
_SCALE_ALARM = 1e-3  # controller and tracker disagree by 0.1 % of the arc


def geometry_findings(identified: SweptAxes, names: tuple[str, ...]) -> tuple[GeometryFinding, ...]:
    """The findings of all sweeps; `names` are those of the targets."""
    return tuple(finding for fit in identified.fits for finding in sweep_findings(fit, names))


def sweep_findings(fit: AxisFit | CoupledFit, names: tuple[str, ...]) -> tuple[GeometryFinding, ...]:
    """Suspicions about one sweep; none about a clean one."""
    found = [_anomaly(fit, anomaly, names) for anomaly in find_anomalies(fit.linear, fit.sweep)]
    if fit.arc < SHORT_ARC:
        found.append(_short_arc(fit))
    found += _variance(fit)
    if abs(fit.angle_scale - 1.0) > _SCALE_ALARM:
        found.append(_scale(fit))
    return tuple(found)


def angle_probability(free: SweptAxes, controller: SweptAxes) -> float:
    """Probability that noise alone makes the controller's angles fit as badly as they do.

    F-test of the fit with the controller's angles inside the one with free angles. Where it is not small,
    `angles="controller"` is justified by the readings, and the better estimate.
    """
    more = controller.dof - free.dof
    if more < 1:
        return 1.0
    gain = max(controller.rss - free.rss, 0.0) / more
    return float(stats.f.sf(gain / (free.rss / free.dof), more, free.dof))


def agreement_findings(probability: float | None) -> tuple[GeometryFinding, ...]:
    """Whether all sweeps show the same robot, by the probability that noise makes one fit them so badly.

    Args:
        probability: of the F-test of the fit of all sweeps inside the fits one by one; None if there is none.
    """
    if probability is None or probability >= _CHI_SQUARE_ALARM:
        return ()
    return (
        GeometryFinding(
            "sweeps_disagree",
            "sweeps",
            probability,
            "",
            "one robot does not fit all sweeps as well as each is fitted by itself, which noise does with "
            f"probability {probability:.1g}: uncertainties are too small",
            "fit the sweeps one by one; joints at rest that do not repeat, and gears, do this, too",
        ),
    )


def _anomaly(fit: AxisFit | CoupledFit, anomaly: Anomaly, names: tuple[str, ...]) -> GeometryFinding:
    size = float(np.linalg.norm(anomaly.displacement))
    place = f"{fit.sweep.where}, position {anomaly.position + 1}"
    chance = f"(by chance: {anomaly.probability:.1g})"
    if anomaly.kind == "bump":
        return GeometryFinding(
            "tracker_bumped",
            place,
            size,
            "m",
            f"from this position on all readings are displaced by about {length_text(size)} {chance}: the "
            "tracker or the robot's base was bumped",
            "repeat the sweep, or leave out the positions on one side",
        )
    if anomaly.kind == "position":
        return GeometryFinding(
            "position_suspect",
            place,
            size,
            "m",
            f"all targets are displaced by about {length_text(size)} {chance}",
            "the robot may not have come to rest, or its angles belong elsewhere: leave the position out",
        )
    target = names[anomaly.target] if anomaly.target is not None else ""
    return GeometryFinding(
        "reading_suspect",
        f"{place}, target {target}",
        size,
        "m",
        f"this reading is displaced by about {length_text(size)} {chance}",
        "leave it out or repeat it",
    )


def _short_arc(fit: AxisFit | CoupledFit) -> GeometryFinding:
    spread = float(np.sqrt(np.linalg.eigvalsh(fit.axis_covariance[:2, :2]).max()))
    return GeometryFinding(
        "short_arc",
        fit.sweep.where,
        float(np.degrees(fit.arc)),
        "°",
        f"an arc of {np.degrees(fit.arc):.3g}° places the axis within {length_text(spread)} only",
        "sweep 90° or more",
    )


def _variance(fit: AxisFit | CoupledFit) -> list[GeometryFinding]:
    if not fit.sigma_stated:
        return []
    rms = length_text(float(np.sqrt(fit.rss / fit.dof)))
    stated = length_text(fit.sigma)
    if stats.chi2.sf(fit.rss / fit.sigma**2, fit.dof) < _CHI_SQUARE_ALARM:
        return [
            GeometryFinding(
                "residuals_exceed_sigma",
                fit.sweep.where,
                fit.variance_factor,
                "",
                f"residuals speak for a sigma of {rms}, and {stated} was stated: uncertainties are too small",
                "state the true sigma, or leave it out; robots that do not repeat well do this, too",
            )
        ]
    if stats.chi2.cdf(fit.rss / fit.sigma**2, fit.dof) < _CHI_SQUARE_ALARM:
        return [
            GeometryFinding(
                "residuals_below_sigma",
                fit.sweep.where,
                fit.variance_factor,
                "",
                f"residuals speak for a sigma of {rms}, and {stated} was stated: uncertainties are too large",
                "check the unit of sigma",
            )
        ]
    return []


def _scale(fit: AxisFit | CoupledFit) -> GeometryFinding:
    return GeometryFinding(
        "angle_scale_suspect",
        fit.sweep.where,
        fit.angle_scale,
        "",
        f"the joint turned {fit.angle_scale:.4f} times as far as controller and joint map say",
        "check the joint map, the unit of the angles, and that rows were not exchanged",
    )
