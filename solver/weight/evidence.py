"""Each joint's interval with what it is due to, and the reasons not to use a result as it stands."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy import stats

from jointstiff.solver.convex.weighed import ends
from jointstiff.solver.finding import length_text
from jointstiff.solver.inference.reason import Reason
from jointstiff.solver.inference.verdict import JointCompliance
from jointstiff.solver.robot.model import Robot
from jointstiff.solver.weight.fit import WeightFit

_BEYOND_CHANCE: Final = 1e-3
"""Probability of chance below which residuals or masses count as contradicted."""
_AT_CAP: Final = 0.5
"""Share of the greatest compliance that counts as no bound at all."""


@dataclass(frozen=True)
class WeightedJoint:
    """Result for one joint, with what its interval is due to."""

    joint: JointCompliance  #: compliance, interval, status
    #: width of the interval that exact masses would leave, over its width; None without an interval
    share_of_readings: float | None = None

    @property
    def share_of_masses(self) -> float | None:
        """Return the rest of the width, which better masses would take away."""
        return None if self.share_of_readings is None else 1.0 - self.share_of_readings


def reasons_of(fit: WeightFit, rank: int, freedom: int, *, stated: float | None) -> Iterator[Reason]:
    """Yield what speaks against the result: residuals beyond sigma, and masses that the readings contradict.

    Both sums are χ² where the model holds: that of all that no compliance, weight or geometry explains, and
    that by which the bounds of the masses raise it.
    """
    outside, loss = fit.reduced.outside, fit.optimum.loss
    if stated is not None and stats.chi2.sf(outside, freedom) < _BEYOND_CHANCE:
        factor = float(np.sqrt(outside / freedom))
        yield Reason(
            "residuals_exceed_sigma",
            "use_with_care",
            None,
            f"the residuals give sigma = {length_text(factor * stated)}, but {length_text(stated)} was "
            "stated: something bends or moves that neither geometry nor own weight explains",
            "look for gears, links that bend, a target or base that moved; intervals are of the larger sigma",
        )
        chance = stats.f.sf(loss / rank / (outside / freedom), rank, freedom)
    elif stated is not None:
        chance = stats.chi2.sf(loss, rank)
    else:
        chance = stats.f.sf(loss / rank / (outside / freedom), rank, freedom)
    if chance < _BEYOND_CHANCE:
        yield Reason(
            "masses_contradicted",
            "do_not_use",
            None,
            f"no masses and centres of mass within their bounds explain the readings (p = {chance:.1g})",
            "check masses, centres of mass, their frames, and what hung on the flange; or widen the bounds",
        )


def joints_of(robot: Robot, fit: WeightFit, sigma: float, rise: float) -> tuple[WeightedJoint, ...]:
    """Return the joints with their intervals.

    Args:
        robot: n joints.
        fit: of the same.
        sigma: of a residual, in the fit's unit.
        rise: of the loss that chance allows at the level of the intervals.
    """
    problem = fit.reduced
    found = ends(problem.A, problem.b, fit.optimum, rise, problem.cones)
    first = problem.cones.first
    exact = np.sqrt(rise) * np.linalg.norm(np.linalg.pinv(problem.A[:, first]), axis=1)
    joints = [
        WeightedJoint(JointCompliance(name, "not_observable", reason=_constant(fit, j, name)))
        for j, name in enumerate(robot.joint_names)
    ]
    for k, j in enumerate(problem.seen.tolist()):
        name, unit, (low, high) = robot.joint_names[j], problem.unit[k], found.ends[k]
        if not np.isfinite(high - low) or high >= _AT_CAP * problem.cones.cap[k]:
            reason = (
                f"own weight and readings leave the compliance of {name} open: read more postures in which "
                "its weight torque differs, or hang on a known payload"
            )
            joints[j] = WeightedJoint(JointCompliance(name, "not_observable", reason=reason))
            continue
        c = float(fit.compliance[j])
        share = min(1.0, 2.0 * float(exact[k]) / (high - low))
        wide = f"the interval reaches from rigid to {high / max(c / unit, 1e-300):.2g} times the estimate"
        joints[j] = WeightedJoint(
            JointCompliance(
                name,
                "at_bound" if c == 0.0 else "identified" if low > 0.0 else "uncertain",
                c,
                float(0.5 * (high - low) * unit * sigma / np.sqrt(rise)),
                (float(low * unit), float(high * unit)),
                reason=None if low > 0.0 else f"{wide}: add postures, better masses or a known payload",
            ),
            share,
        )
    return tuple(joints)


def _constant(fit: WeightFit, j: int, name: str) -> str:
    """Say why a joint has no number."""
    torque = fit.rows.torques.known[:, j]
    return (
        f"its weight torque hardly varies over the postures ({torque.min():.3g} to {torque.max():.3g} N·m), "
        f"so that its sag is an offset of {name}'s angle: hang a known payload off its axis, or pull across "
        "it with a known force; a vertical axis carries no weight at all"
    )
