"""Two independent estimates of one compliance: their ratio by Fieller's theorem, and whether they differ.

For Gaussian ĉ₁, ĉ₂ the variable ``ĉ₁ − ρ ĉ₂`` has mean zero at the true ratio ρ = c₁/c₂ = k₂/k₁, so that
``|ĉ₁ − ρ ĉ₂| ≤ t √(s₁² + ρ² s₂²)`` holds with exactly the probability of t (E. C. Fieller, *Some problems in
interval estimation*, J. R. Stat. Soc. B 16, 1954). In units of the uncertainties, with the point
``(ĉ₂/s₂, ĉ₁/s₁)`` at distance r and angle θ, it is ``|sin(θ − φ)| ≤ t/r`` for ``tan φ = ρ s₂/s₁``: an arc of
directions. It may pass through the vertical, where the ratio is infinite: then it has no upper limit.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import asin, atan2, hypot, inf, isfinite, pi, tan

from scipy import special

from jointstiff.solver.errors import RequestError

_QUARTER = pi / 2


@dataclass(frozen=True)
class GaussianEstimate:
    """An unconstrained estimate of a compliance.

    Raises:
        RequestError: if the uncertainty is not positive and finite, or the degrees of freedom are not
            positive.
    """

    value: float  #: [rad/(N·m)]
    standard_uncertainty: float  #: positive, in the same unit
    degrees_of_freedom: float = inf  #: degrees of freedom of that uncertainty; inf where sigma was given

    def __post_init__(self) -> None:
        known = 0.0 < self.standard_uncertainty < inf and isfinite(self.value)
        if not known or not self.degrees_of_freedom > 0:
            raise RequestError(
                "a compliance without an uncertainty cannot be compared",
                where="noise",
                remedy="state `noise.sigma`, or add observations",
            )


@dataclass(frozen=True)
class RatioInterval:
    """All ratios that the estimates do not exclude, or the least interval that holds them."""

    lower: float | None  #: None where there is no lower limit
    upper: float | None  #: None where there is no upper limit
    #: where the ratios are those outside an interval, that interval; else None
    excluded: tuple[float, float] | None = None


def two_sided_quantile(confidence: float, degrees_of_freedom: float) -> float:
    """Quantile t of Student's distribution, of the normal one for inf, that ±t covers `confidence`."""
    tail = 0.5 + confidence / 2
    if degrees_of_freedom == inf:
        return float(special.ndtri(tail))
    return float(special.stdtrit(degrees_of_freedom, tail))


def ratio_interval(
    first: GaussianEstimate, second: GaussianEstimate, confidence: float, *, positive: bool
) -> RatioInterval | None:
    """Fieller's interval of c_first / c_second = k_second / k_first.

    Exact where both uncertainties have the same degrees of freedom from one sigma, or sigma is given; else
    the fewer degrees of freedom are taken, which covers at least as often.

    Args:
        first: of the first compliance.
        second: of the second, independent of it.
        confidence: between 0 and 1.
        positive: whether both compliances are known to be zero or positive: the ratio is, too.

    Returns:
        The interval; None if `positive` and all ratios that the estimates allow are negative.
    """
    freedom = min(first.degrees_of_freedom, second.degrees_of_freedom)
    t = two_sided_quantile(confidence, freedom)
    y = first.value / first.standard_uncertainty
    x = second.value / second.standard_uncertainty
    scale = first.standard_uncertainty / second.standard_uncertainty
    r = hypot(x, y)
    if r <= t:
        return RatioInterval(0.0 if positive else None, None)
    angle = atan2(y, x)
    if angle > _QUARTER or angle <= -_QUARTER:  # a ratio does not change when both signs do
        angle -= pi if angle > 0 else -pi
    half_width = asin(t / r)
    low, high = angle - half_width, angle + half_width
    if positive:
        return _positive_part(low, high, scale)
    # The arc [low, high], repeated every half turn, as ratios
    if low > -_QUARTER and high < _QUARTER:
        return RatioInterval(scale * tan(low), scale * tan(high))
    through = low + pi if low <= -_QUARTER else low
    until = high if low <= -_QUARTER else high - pi
    return RatioInterval(None, None, (scale * tan(until), scale * tan(through)))


def _positive_part(low: float, high: float, scale: float) -> RatioInterval | None:
    """Return what of the arc, repeated every half turn, lies between 0 and a quarter turn."""
    shifted = ((low + turn, high + turn) for turn in (-pi, 0.0, pi))
    pieces = [(max(0.0, a), min(_QUARTER, b)) for a, b in shifted if a <= _QUARTER and b >= 0.0]
    if not pieces:
        return None
    least, greatest = min(a for a, _ in pieces), max(b for _, b in pieces)
    excluded = None
    if len(pieces) > 1:
        ends = sorted(pieces)
        excluded = scale * tan(ends[0][1]), scale * tan(ends[1][0])
    return RatioInterval(
        scale * tan(least), None if greatest >= _QUARTER else scale * tan(greatest), excluded
    )


def difference_p_value(first: GaussianEstimate, second: GaussianEstimate) -> float:
    """Probability of estimates at least this far apart if the compliance has not changed (two-sided)."""
    spread = hypot(first.standard_uncertainty, second.standard_uncertainty)
    distance = abs(first.value - second.value) / spread
    freedom = min(first.degrees_of_freedom, second.degrees_of_freedom)
    if freedom == inf:
        return float(2.0 * special.ndtr(-distance))
    return float(2.0 * special.stdtr(freedom, -distance))
