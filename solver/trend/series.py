"""Stiffness of one joint, campaign after campaign, as logarithms with their standard uncertainties."""

from __future__ import annotations

from dataclasses import dataclass
from math import exp, hypot, log, sqrt
from typing import Final

import numpy as np
from scipy import special

from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.errors import RequestError

MOST_RELATIVE: Final = 0.25
"""Largest u(c) / c of a point in a chart: beyond it, ln c is neither normal nor free of bias (u² / 2)."""

_MOST_SHARED: Final = 0.999999
"""Largest share of an uncertainty that may be the same in all campaigns: readings always have their own."""


@dataclass(frozen=True)
class Series:
    """One joint over its campaigns, oldest first.

    Raises:
        RequestError: if a value or an uncertainty is not finite, or an uncertainty not positive.
    """

    values: FloatArray  #: ln k (m,), k in N·m/rad
    uncertainties: FloatArray  #: standard uncertainties of ln k (m,), positive

    def __post_init__(self) -> None:
        values, uncertainties = self.values, self.uncertainties
        fits = values.ndim == 1 and values.shape == uncertainties.shape
        if not fits or not np.all(np.isfinite(values) & np.isfinite(uncertainties) & (uncertainties > 0)):
            raise RequestError(
                "a campaign without a finite stiffness and uncertainty cannot be charted",
                remedy="omit this campaign, and give the reason",
            )


def log_stiffness(
    compliance: float | None, standard_uncertainty: float | None, shared: float = 0.0
) -> tuple[float, float] | None:
    """Return ln k = -ln c and its standard uncertainty u(c) / c.

    Compliance is what the readings determine; its logarithm has the same relative uncertainty as that of
    the stiffness, and no greatest value has to be made up for a joint that may be rigid.

    Args:
        compliance: [rad/(N·m)].
        standard_uncertainty: of the compliance [rad/(N·m)].
        shared: part of it that is the same error in all campaigns, such as the scale of one load cell
            [rad/(N·m)]: no difference between campaigns holds it.

    Returns:
        None for a joint without a number, for a rigid one, and where the campaign's own part of u(c) / c
        exceeds `MOST_RELATIVE`: an interval of such a stiffness is open or nearly so.
    """
    if compliance is None or standard_uncertainty is None or not compliance > 0:
        return None
    own = standard_uncertainty**2 - min(shared, _MOST_SHARED * standard_uncertainty) ** 2
    relative = sqrt(own) / compliance
    return (-log(compliance), relative) if 0 < relative <= MOST_RELATIVE else None


@dataclass(frozen=True)
class Change:
    """Change of ln k, with its standard uncertainty."""

    difference: float  #: difference of ln k
    standard_uncertainty: float  #: standard uncertainty of the difference

    @property
    def relative(self) -> float:
        """Relative change of the stiffness, such as -0.1 for a joint that is 10 % softer."""
        return exp(self.difference) - 1.0

    @property
    def relative_uncertainty(self) -> float:
        """Standard uncertainty of the relative change."""
        return exp(self.difference) * self.standard_uncertainty

    @property
    def p_value(self) -> float:
        """Probability of a change at least as large if the stiffness is the same (two-sided)."""
        return float(2.0 * special.ndtr(-abs(self.difference) / self.standard_uncertainty))


def change_between(series: Series, first: int, second: int) -> Change:
    """Return the change from one campaign to another: a test of the pair, with the readings' noise alone."""
    values, uncertainties = series.values, series.uncertainties
    return Change(float(values[second] - values[first]), hypot(uncertainties[first], uncertainties[second]))
