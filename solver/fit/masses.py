"""Masses that the readings contradict, and masses that they do not check (method.md §14).

The convex program of own weight lets each joint have different masses: its intervals are therefore outer
bounds, and a wrong mass stays hidden. Here all joints share the masses, ``x_j = c_j (1, ζ)`` with deviations
ζ in units of their bounds. Each ζ has the standard uncertainty 1/√3 of a uniform distribution within the
bounds:

    minimise ‖A x(c, ζ) − b‖² + 3 Σ ζ_k²

The bounds of each mass are dropped in turn, to see by how much the minimum falls. The problem is not convex
in (c, ζ), so that its compliances are not published as results.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final, NamedTuple

import numpy as np

from jointstiff.schemas.finding import Finding
from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.fit.weight_rows import Burden, ReducedProblem
from jointstiff.solver.mechanics.robot import Body

CONTRADICTED: Final = 9.0
"""Fall of χ² with one mass freed from its bounds, above which the readings contradict the mass: in 2 % of 200
campaigns with right masses a mass was contradicted."""
_CHECKED: Final = 5.0
"""Ratio of a mass to its standard uncertainty, from which on nearly every campaign shows that a mass is twice
the stated one: 3 standard uncertainties to contradict a mass, and 2 for the dispersion of the campaigns."""
_MATTERS: Final = 0.1
"""Relative change of a compliance from which on an unchecked mass is reported."""
_FREE: Final = 1e-4
"""Factor on the prior of a mass that is freed from its bounds: so weak a prior only determines masses that no
reading depends on."""


@dataclass(frozen=True, eq=False)
class FreedMass:
    """Result of a fit in which one body's mass is freed from its bounds."""

    body: int  #: index of the body
    mass: float  #: mass of the body that fits the readings best [kg]
    uncertainty: float  #: standard uncertainty of the mass [kg]; infinite if no reading determines the mass
    gain: float  #: fall of χ² relative to the fit with all bounds
    #: (m,) relative change of the compliances of the m observed joints if the mass is twice the stated mass
    change_if_doubled: FloatArray


class _UncertainMass(NamedTuple):
    """Mass whose deviation ζ_k from the middle of its bounds changes the torque of a joint."""

    k: int  # index of the deviation
    body: int  # index of the body
    mean: float  # middle of the bounds [kg]
    half_range: float  # from the middle to a bound, the unit of ζ_k [kg]


def fit_freed_masses(problem: ReducedProblem, burden: Burden, noise_variance: float) -> list[FreedMass]:
    """Fit the readings with each uncertain mass freed from its bounds in turn.

    Args:
        problem: convex problem of the last step.
        burden: bodies and springs.
        noise_variance: mean square of the residuals, in the squared unit of the problem's rows.

    Returns:
        One result for each uncertain mass that changes the torque of a joint.
    """
    from scipy.optimize import least_squares

    # The unknowns are y = (c, ζ): n compliances, then the deviations of the masses. A block has the slice of
    # a joint's parameters in x, and the indices in y of the deviations that act on the joint.
    n = len(problem.unit)
    blocks = [
        (span, n + np.array(unknown_indices, dtype=np.intp)) for *_, span, unknown_indices in problem.blocks
    ]
    squares, cone = problem.convex.squares, problem.convex.cone
    size = squares.R.shape[1]
    count = max((k + 1 for unknown_indices in problem.unknowns for k in unknown_indices), default=0)
    masses = _list_uncertain_masses(problem, burden)
    lower = np.full(n + count, -np.inf)
    lower[:n] = 0.0
    for mass in masses:
        lower[n + mass.k] = -mass.mean / mass.half_range  # no mass is negative
    bounds = (lower, np.concatenate([cone.cap, np.full(count, np.inf)]))
    scale = np.sqrt(noise_variance)

    def fit_masses(start: FloatArray, free: int | None) -> tuple[FloatArray, float, FloatArray]:
        """Fit y = (c, ζ); return y, the loss and the Jacobian of the residuals.

        Args:
            start: y at which the search starts.
            free: index of the deviation ζ whose bounds are dropped; None drops none.
        """
        # A mass is uniform within its bounds at ζ = ±1, of variance 1/3; a free one has hardly any prior.
        weakening = np.where(np.arange(count) == free, _FREE, 1.0)
        prior = np.sqrt(3.0) * np.eye(n + count)[n:] * weakening[:, None]

        def compute_residuals(y: FloatArray) -> FloatArray:
            """Return the residuals of the readings, then of the prior, at y = (c, ζ)."""
            x = np.zeros(size)
            for i, (span, deviations) in enumerate(blocks):
                x[span] = y[i] * np.array([1.0, *y[deviations]])
            return np.concatenate([(squares.R @ x - squares.z) / scale, prior @ y])

        def compute_jacobian(y: FloatArray) -> FloatArray:
            """Return the Jacobian of the residuals with respect to y at y = (c, ζ)."""
            x_slopes = np.zeros((size, n + count))
            for i, (span, deviations) in enumerate(blocks):
                joint_slopes = x_slopes[span]  # a view: writing to it changes x_slopes
                joint_slopes[:, i] = 1.0, *y[deviations]
                joint_slopes[1 + np.arange(len(deviations)), deviations] = y[i]
            return np.concatenate([squares.R @ x_slopes / scale, prior])

        found = least_squares(compute_residuals, start, compute_jacobian, bounds=bounds, x_scale="jac")
        return found.x, 2.0 * float(found.cost), np.asarray(found.jac)

    # The search starts from the compliances that fit the readings with nominal masses.
    compliance_columns = squares.R[:, cone.first]
    nominal_fit = np.clip(np.linalg.lstsq(compliance_columns, squares.z)[0], 0.0, cone.cap)
    bounded_y, bounded_loss, _ = fit_masses(np.concatenate([nominal_fit, np.zeros(count)]), None)
    freed = []
    for mass in masses:
        y, freed_loss, jacobian = fit_masses(bounded_y, mass.k)
        root = np.linalg.pinv(jacobian, rcond=0.0)  # root rootᵀ is the covariance of y
        root_of_mass = root[n + mass.k]
        variance = float(root_of_mass @ root_of_mass)
        slope = root[:n] @ root_of_mass / variance  # derivative of the compliances with respect to ζ_k
        # A compliance near zero is replaced by its uncertainty for a mass that is fixed as stated.
        uncertainty_if_fixed = np.linalg.norm(root[:n] - np.outer(slope, root_of_mass), axis=1)
        reference = np.maximum(y[:n], uncertainty_if_fixed)
        reference = np.where(reference > 0.0, reference, np.inf)
        # The weak prior alone gives the variance 1 / (3 _FREE²): the readings must at least halve it.
        is_determined = 3.0 * _FREE**2 * variance < 0.5
        freed_mass = FreedMass(
            body=mass.body,
            mass=mass.mean + mass.half_range * float(y[n + mass.k]),
            uncertainty=mass.half_range * float(np.sqrt(variance)) if is_determined else np.inf,
            gain=bounded_loss - freed_loss,
            change_if_doubled=mass.mean / mass.half_range * slope / reference,
        )
        freed.append(freed_mass)
    return freed


def _list_uncertain_masses(problem: ReducedProblem, burden: Burden) -> list[_UncertainMass]:
    """Return the masses with bounds that change the torque of a joint."""
    changes_a_torque = {k for *_, unknown_indices in problem.blocks for k in unknown_indices}
    unknown_inertias, _ = burden.unknown
    masses = list[_UncertainMass]()
    for k, unknown in enumerate(unknown_inertias):
        half_range = float(unknown.greatest[0])  # zero for an unknown first moment, which has no mass
        if half_range > 0.0 and k in changes_a_torque:
            body = burden.bodies[unknown.body]
            masses.append(_UncertainMass(k, unknown.body, 0.5 * (body.most + body.least), half_range))
    return masses


def find_contradicted_mass(freed: Sequence[FreedMass]) -> FreedMass | None:
    """Return the mass that the readings contradict most; None if they contradict no mass."""
    determined = (each for each in freed if np.isfinite(each.uncertainty))
    worst = max(determined, key=lambda each: each.gain, default=None)
    if worst is None or worst.gain <= CONTRADICTED:
        return None
    return worst


def widen_mass_bounds(bodies: Sequence[Body], wrong_mass: FreedMass) -> tuple[Body, ...]:
    """Return the bodies, with the wrong mass's bounds widened to its fitted value ± two uncertainties."""
    lower = wrong_mass.mass - 2.0 * wrong_mass.uncertainty
    upper = wrong_mass.mass + 2.0 * wrong_mass.uncertainty
    body = bodies[wrong_mass.body]
    widened = replace(body, least=max(0.0, min(body.least, lower)), most=max(body.most, upper))
    return (*bodies[: wrong_mass.body], widened, *bodies[wrong_mass.body + 1 :])


def report_contradicted_mass(body: Body, wrong_mass: FreedMass, *, covered: bool = True) -> Finding:
    """Build the finding about a mass that the readings contradict.

    Args:
        body: body with the stated mass.
        wrong_mass: fit of the mass without bounds.
        covered: whether the intervals of the result cover both the stated and the fitted mass.
    """
    coverage = "The intervals cover both masses" if covered else "No fit that allows both masses converged"
    return Finding(
        code="masses_contradicted",
        weight="use_with_care" if covered else "do_not_use",
        message=f"the readings contradict the mass of {body.name}: the readings suggest "
        f"{wrong_mass.mass:.3g} kg (u = {wrong_mass.uncertainty:.2g} kg) instead of {body.mass:.3g} kg, "
        f"and χ² falls by {wrong_mass.gain:.3g}. {coverage}",
        remedy=f"check the mass of {body.name}, the masses of its neighbours and what hung on the flange; a "
        "known payload in some of the postures shows whether a stiffness or a mass is wrong",
    )


def report_unchecked_masses(bodies: Sequence[Body], freed: Sequence[FreedMass]) -> Finding | None:
    """Build the finding about masses that affect a stiffness but are not checked by the readings.

    If the readings check all masses that matter, None is returned.
    """
    names, change = [], 0.0
    for each in freed:
        effect = float(np.abs(each.change_if_doubled).max(initial=0.0))
        if bodies[each.body].mass < _CHECKED * each.uncertainty and effect > _MATTERS:
            names.append(bodies[each.body].name)
            change = max(change, effect)
    if not names:
        return None
    return Finding(
        code="masses_unchecked",
        weight="use",
        message=f"the readings do not check the mass of {', '.join(names)}: twice the stated mass might not "
        f"be noticed, and would change a compliance by up to {100 * change:.2g} %",
        remedy="check these masses, or hang a known payload in half of the postures",
    )
