"""The estimate: joint compliances with uncertainty, verdict and evidence (METHOD.md §6)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt
from scipy import special

from solver.compression import Compression
from solver.exceptions import MeasurementError
from solver.identifiability import Identifiability, Visibility
from solver.methods import Fit
from solver.problem import Bounds
from solver.solve import Certificate

__all__ = ["Estimate", "JointCompliance", "assemble"]

FloatArray = npt.NDArray[np.float64]

_NO_UNCERTAINTY = (
    "its uncertainty is unknown, as there are no more readings than joints and sigma is not given: "
    "state noise, or measure more"
)


@dataclass(frozen=True)
class JointCompliance:
    """What the readings say of one joint; numbers are None where they say nothing.

    Attributes:
        compliance: [rad/(N·m)].
        standard_uncertainty: of the compliance, without constraints [rad/(N·m)].
        interval: coverage interval of the compliance, cut at the bounds [rad/(N·m)].
        reason: why there is no number, or which bound holds it.
    """

    name: str
    status: Literal["identified", "at_bound", "not_observable"]
    compliance: float | None = None
    standard_uncertainty: float | None = None
    interval: tuple[float, float] | None = None
    reason: str | None = None


@dataclass(frozen=True, eq=False)
class Estimate:
    """Joint compliances with their evidence.

    Attributes:
        joints: one verdict a joint.
        compliance: (n,) the optimum that predictions use [rad/(N·m)]. Entries of joints that are not
            observable are no estimates; `joints` withholds them.
        covariance: (n, n) of the unconstrained estimate [(rad/(N·m))²]; None where sigma is unknown.
        sigma: standard uncertainty of one coordinate of one reading [m]; None where it was not given
            and there are no degrees of freedom to estimate it from.
        sigma_given: whether sigma was stated with the readings.
        chi_square: of the targets' residuals, under sigma.
        degrees_of_freedom: expectation of chi_square where model and sigma are right.
        characteristic_length: [m], where the weighting used one.
        identifiability: of each stage of the method.
        certificates: of each stage of the method.
    """

    joints: tuple[JointCompliance, ...]
    compliance: FloatArray
    covariance: FloatArray | None
    sigma: float | None
    sigma_given: bool
    chi_square: float
    degrees_of_freedom: float
    characteristic_length: float | None
    identifiability: tuple[Identifiability, ...]
    certificates: tuple[Certificate, ...]


@dataclass(frozen=True, eq=False)
class _Scale:
    """What the residuals say of sigma."""

    sigma: float | None
    chi_square: float
    degrees_of_freedom: float
    quantile: float


def assemble(
    fit: Fit,
    visibility: Visibility,
    whitened: Compression,
    *,
    names: tuple[str, ...],
    sigma: float | None,
    confidence: float,
    bounds: Bounds,
    characteristic_length: float | None,
) -> Estimate:
    """Give the fit its scale, its uncertainties and its verdicts.

    Args:
        fit: outcome of the method.
        visibility: of the same observations.
        whitened: compressed rows of all targets, whitened in units of sigma.
        names: of the n joints.
        sigma: as stated with the readings [m], or None.
        confidence: level of the intervals.
        bounds: on the compliances.
        characteristic_length: [m], if one was used.

    Returns:
        The estimate.
    """
    scale = _scale(fit, whitened, sigma, confidence)
    covariance = None if scale.sigma is None else np.float64(scale.sigma) ** 2 * fit.covariance
    _refuse_overflow(scale, fit, covariance)
    joints = tuple(
        _verdict(j, names, fit, visibility, covariance, scale.quantile, bounds) for j in range(len(names))
    )
    return Estimate(
        joints=joints,
        compliance=fit.compliance,
        covariance=covariance,
        sigma=scale.sigma,
        sigma_given=sigma is not None,
        chi_square=scale.chi_square,
        degrees_of_freedom=scale.degrees_of_freedom,
        characteristic_length=characteristic_length,
        identifiability=fit.identifiability,
        certificates=fit.certificates,
    )


def _refuse_overflow(scale: _Scale, fit: Fit, covariance: FloatArray | None) -> None:
    numbers = [fit.compliance, np.array([scale.chi_square, scale.degrees_of_freedom])]
    numbers += [] if covariance is None else [covariance]
    if not all(np.isfinite(array).all() for array in numbers):
        raise MeasurementError(
            "the numbers overflow: loads, lengths and sigma are of magnitudes that do not go together",
            where="units",
            remedy="check the units of force, length and sigma",
        )


def _scale(fit: Fit, whitened: Compression, sigma: float | None, confidence: float) -> _Scale:
    """Chi-square of the targets' residuals, its degrees of freedom, and sigma.

    For any linear unbiased ĉ of covariance C, ``E[χ²] = rows − 2 p + tr(AᵀΣ⁻¹A C)``; for weighted
    least squares that is rows − p. It lets the three methods be judged on the same readings.
    """
    R = whitened.matrix
    squares = float(np.sum((R @ fit.compliance - whitened.rhs) ** 2))
    parameters = sum(analysis.rank for analysis in fit.identifiability)
    information = float(np.sum((R @ fit.covariance) * R))
    freedom = max(0.0, whitened.rows - 2 * parameters + information)
    tail = 0.5 + confidence / 2
    if sigma is not None:
        with np.errstate(all="ignore"):  # an overflow is refused later, with its remedy
            chi_square = float(np.float64(squares) / np.float64(sigma) ** 2)
        return _Scale(sigma, chi_square, freedom, float(special.ndtri(tail)))
    if freedom < 0.5:
        return _Scale(None, 0.0, freedom, float("inf"))
    estimated = float(np.sqrt(squares / freedom))
    return _Scale(estimated, freedom, freedom, float(special.stdtrit(freedom, tail)))


def _verdict(
    j: int,
    names: tuple[str, ...],
    fit: Fit,
    visibility: Visibility,
    covariance: FloatArray | None,
    quantile: float,
    bounds: Bounds,
) -> JointCompliance:
    name = names[j]
    uncertainty = None if covariance is None else float(np.sqrt(covariance[j, j]))
    hidden = _hidden(j, names, fit, visibility, uncertainty)
    if hidden is not None:
        return JointCompliance(name, "not_observable", reason=hidden)
    value = float(fit.compliance[j])
    if fit.active[j]:
        bound = "greatest" if fit.active[j] < 0 else "least"
        why = (
            "its compliance is at zero: these readings cannot tell it from rigid"
            if value == 0.0
            else f"it is held by the {bound} stiffness that was asked for"
        )
        return JointCompliance(name, "at_bound", value, uncertainty, None, why)
    interval = None
    if uncertainty is not None:
        interval = (
            max(value - quantile * uncertainty, float(bounds.lower[j])),
            min(value + quantile * uncertainty, float(bounds.upper[j])),
        )
    reason = _NO_UNCERTAINTY if uncertainty is None else None
    return JointCompliance(name, "identified", value, uncertainty, interval, reason)


def _hidden(
    j: int,
    names: tuple[str, ...],
    fit: Fit,
    visibility: Visibility,
    uncertainty: float | None,
) -> str | None:
    """Why joint j has no number, or None if it has one."""
    if visibility.null[j]:
        return visibility.reasons[j]
    for analysis in fit.identifiability:
        for group in analysis.combinations:
            if j in group.joints:
                together = ", ".join(names[k] for k in group.joints)
                return (
                    f"only a combination of {together} shows in the readings: add postures in which "
                    "their axes differ"
                )
    reference = float(visibility.reference_compliance[j])
    if uncertainty is not None and uncertainty > reference:
        return (
            f"the noise hides {names[j]}: its standard uncertainty of {uncertainty:.2g} rad/(N.m) "
            f"exceeds {reference:.2g} rad/(N.m), with which it alone would explain all that moved; "
            "add loads that twist it more"
        )
    return None
