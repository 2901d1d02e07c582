"""Masses that the readings contradict, and masses that they do not check (method.md §14).

The convex program of own weight gives each joint masses of its own: that makes its intervals outer bounds,
and hides a wrong mass. Here all joints share them, ``x_j = c_j (1, ζ)`` with deviations ζ in units of their
bounds, each with the standard uncertainty 1/√3 of what is uniform within them:

    minimise ‖A x(c, ζ) − b‖² + 3 Σ ζ_k²

Each mass is left free in turn, to see by how much that falls. The program is not convex in (c, ζ), and no
number of it is published as a result.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from jointstiff.schemas.finding import Finding
from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.mechanics.robot import Body
from jointstiff.solver.own_weight.rows import Burden, ReducedProblem

CONTRADICTED: Final = 9.0
"""Fall of χ² with one mass free that contradicts it: 2 % of 200 campaigns with right masses have one."""
_CHECKED: Final = 5.0
"""Standard uncertainties by which a doubled mass is off where nearly every campaign shows it (3 + 2)."""
_MATTERS: Final = 0.1
"""Relative change of a compliance that is worth a remark."""
_FREE: Final = 1e-4
"""Weight of the bounds of a mass left free, which settles a mass that no reading shows."""


@dataclass(frozen=True, eq=False)
class FreedMass:
    """Fit of masses that all joints share, one of them without its bounds."""

    body: int  #: index of the body whose mass is free
    mass: float  #: mass that fits the readings best [kg]
    uncertainty: float  #: standard uncertainty [kg]; infinite where no reading determines the mass
    gain: float  #: fall of χ² with the mass free
    doubled: FloatArray  #: (n_seen,) relative change of the compliances if the mass is twice that stated


def fit_freed_masses(problem: ReducedProblem, burden: Burden, noise: float) -> list[FreedMass]:
    """Fit the readings with each uncertain mass freed from its bounds in turn.

    Args:
        problem: convex problem of the last step.
        burden: bodies and springs.
        noise: mean square of the residuals, in units of sigma².

    Returns:
        One fit for each uncertain mass that changes the torque of a joint.
    """
    from scipy.optimize import least_squares

    # The unknowns are y = (c, ζ): n compliances, then the deviations of the masses.
    blocks = [(place, len(problem.unit) + np.array(own, dtype=np.intp)) for *_, place, own in problem.blocks]
    n, size = len(blocks), problem.A.shape[1]
    count = max((k + 1 for own in problem.unknowns for k in own), default=0)
    halves = [(k, number, half) for k, (number, (half, *_)) in enumerate(burden.unknown[0]) if half > 0.0]
    means = [0.5 * (body.most + body.least) for body in burden.bodies]
    least = np.full(n + count, -np.inf)
    least[:n] = 0.0
    seen = [(k, number, half) for k, number, half in halves if any((own == n + k).any() for _, own in blocks)]
    for k, number, half in seen:
        least[n + k] = -means[number] / half  # no mass is negative
    bounds = (least, np.concatenate([problem.cones.cap, np.full(count, np.inf)]))
    scale = np.sqrt(noise)

    def fit_masses(start: FloatArray, free: int | None) -> tuple[FloatArray, float, FloatArray]:
        """Fit y = (c, ζ); return y, the loss and the Jacobian of the residuals.

        Args:
            start: y at which the search starts.
            free: index of the deviation ζ whose bounds are dropped; None drops none.
        """
        prior = np.sqrt(3.0) * np.eye(n + count)[n:] * np.where(np.arange(count) == free, _FREE, 1.0)[:, None]

        def compute_residuals(y: FloatArray) -> FloatArray:
            """Return the residuals of the readings, then of the prior, at y = (c, ζ)."""
            x = np.zeros(size)
            for i, (place, own) in enumerate(blocks):
                x[place] = y[i] * np.array([1.0, *y[own]])
            return np.concatenate([(problem.A @ x - problem.b) / scale, prior @ y])

        def compute_jacobian(y: FloatArray) -> FloatArray:
            """Return the Jacobian of the residuals with respect to y at y = (c, ζ)."""
            x_slopes = np.zeros((size, n + count))
            for i, (place, own) in enumerate(blocks):
                part = x_slopes[place]
                part[:, i] = 1.0, *y[own]
                part[1 + np.arange(len(own)), own] = y[i]
            return np.concatenate([problem.A @ x_slopes / scale, prior])

        found = least_squares(compute_residuals, start, compute_jacobian, bounds=bounds, x_scale="jac")
        return found.x, 2.0 * float(found.cost), np.asarray(found.jac)

    by_joints = problem.A[:, problem.cones.first]
    alone = np.clip(np.linalg.lstsq(by_joints, problem.b)[0], 0.0, problem.cones.cap)
    common, loss, _ = fit_masses(np.concatenate([alone, np.zeros(count)]), None)
    freed = []
    for k, number, half in seen:
        y, left, jacobian = fit_masses(common, k)
        root = np.linalg.pinv(jacobian, rcond=0.0)
        variance = float(root[n + k] @ root[n + k])
        slope = root[:n] @ root[n + k] / variance
        # A compliance near zero is replaced by its uncertainty with the mass held as stated.
        rest = np.maximum(y[:n], np.linalg.norm(root[:n] - np.outer(slope, root[n + k]), axis=1))
        doubled = means[number] / half * slope / np.where(rest > 0.0, rest, np.inf)
        is_determined = 3.0 * _FREE**2 * variance < 0.5
        mass = means[number] + half * float(y[n + k])
        uncertainty = half * float(np.sqrt(variance)) if is_determined else np.inf
        freed.append(FreedMass(number, mass, uncertainty, loss - left, doubled))
    return freed


def find_contradicted_mass(freed: Sequence[FreedMass]) -> FreedMass | None:
    """Return the mass that the readings contradict most; None if they contradict none."""
    known = (each for each in freed if np.isfinite(each.uncertainty))
    worst = max(known, key=lambda each: each.gain, default=None)
    return None if worst is None or worst.gain <= CONTRADICTED else worst


def widen_mass_bounds(bodies: Sequence[Body], wrong: FreedMass) -> tuple[Body, ...]:
    """Return the bodies; the bounds of the wrong mass are widened to its fitted value ± two uncertainties."""
    low, high = wrong.mass - 2.0 * wrong.uncertainty, wrong.mass + 2.0 * wrong.uncertainty
    body = bodies[wrong.body]
    wide = replace(body, least=max(0.0, min(body.least, low)), most=max(body.most, high))
    return (*bodies[: wrong.body], wide, *bodies[wrong.body + 1 :])


def report_contradicted_mass(body: Body, wrong: FreedMass, *, covered: bool = True) -> Finding:
    """Build the finding about a mass that the readings contradict.

    Args:
        body: body with the stated mass.
        wrong: fit of the mass without bounds.
        covered: whether the intervals of the result cover both the stated and the fitted mass.
    """
    coverage = "The intervals cover both masses" if covered else "No fit that allows both masses converged"
    return Finding(
        code="masses_contradicted",
        weight="use_with_care" if covered else "do_not_use",
        message=f"the readings contradict the mass of {body.name}: they suggest {wrong.mass:.3g} kg "
        f"± {wrong.uncertainty:.2g} kg instead of {body.mass:.3g} kg, and χ² falls by {wrong.gain:.3g}. "
        f"{coverage}",
        remedy=f"check the mass of {body.name}, its neighbours' and what hung on the flange; a known payload "
        "in some of the postures tells stiffness and masses apart",
    )


def report_unchecked_masses(bodies: Sequence[Body], freed: Sequence[FreedMass]) -> Finding | None:
    """Build the finding about masses that affect a stiffness but are not checked by the readings.

    None is returned if there are no such masses.
    """
    names, change = [], 0.0
    for each in freed:
        effect = float(np.abs(each.doubled).max(initial=0.0))
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
