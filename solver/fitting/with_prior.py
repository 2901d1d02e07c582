"""Fits with what is known beforehand: a prior joins the readings as further rows (method.md §5)."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.errors import UnsupportedMethodError
from jointstiff.solver.fitting.fit import Fit
from jointstiff.solver.fitting.methods import MethodAccumulator
from jointstiff.solver.fitting.prior import Prior
from jointstiff.solver.fitting.scale import scale_of
from jointstiff.solver.fitting.settings import Settings
from jointstiff.solver.observability.identifiability import Observability


def fit_with_prior(
    method: MethodAccumulator, observability: Observability, settings: Settings, sigma: float | None
) -> Fit:
    """Fit under the constraints, with the prior if there is one.

    A prior's weight beside the readings is sigma/s₀; a sigma that is not given is estimated first, from the
    readings alone.

    Args:
        method: the rows of all observations.
        observability: of the same.
        settings: constraints and prior.
        sigma: standard uncertainty of one coordinate of one reading [m], or None.

    Returns:
        The fit; with a prior its `alone` is that of the readings alone.

    Raises:
        UnsupportedMethodError: sigma is not given and cannot be estimated.
    """
    alone = method.fit(observability.null, settings.constraints)
    if settings.prior is None:
        return alone
    sigma = scale_of(alone, method.judged.rows, sigma).sigma
    if not sigma:
        raise UnsupportedMethodError(
            "weighting a prior needs sigma, which is not given and cannot be estimated from these readings",
            where="priors",
            remedy="state `noise`, or add observations",
        )
    fit = method.fit(observability.null, settings.constraints, settings.prior.rows(sigma))
    return replace(fit, alone=alone)


def prior_to_data(alone: Fit, prior: Prior, sigma: float) -> FloatArray:
    """Information of the prior over that of the readings, ``s₀⁻² / (sigma² C_jj)⁻¹``, the others unknown.

    Args:
        alone: the fit of the readings alone.
        prior: of the n compliances.
        sigma: standard uncertainty of one coordinate of one reading [m].

    Returns:
        (n,) NaN where there is no prior; inf where the readings determine no more than a combination.
    """
    variance = sigma**2 * np.diagonal(alone.covariance)
    ratio = np.where(prior.known, variance / prior.standard_uncertainty**2, np.nan)
    for group in alone.undetermined:
        for joint in group.joints:
            ratio[joint] = np.inf if prior.known[joint] else np.nan
    return np.asarray(ratio)
