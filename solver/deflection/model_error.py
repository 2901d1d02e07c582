"""Model error: an empirical bound from postures held out, one after the other (method.md §11).

Vovk, Gammerman & Shafer, *Algorithmic Learning in a Random World*, 2005: if a new posture is exchangeable
with those measured, its score lies among theirs as likely at one place as at another. The targets of a
posture share its place (Lee, Barber & Willett, *Distribution-free inference with hierarchical data*, 2023).
Here each score is of a fit of its own, so the argument is no proof: residuals of held-out postures
have no guarantee without assumptions on their distribution (Barber, Candès, Ramdas & Tibshirani, *Predictive
inference with the jackknife+*, 2021).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import ceil
from typing import Final

import numpy as np

from jointstiff.solver.arrays import BoolArray, FloatArray, IndexArray
from jointstiff.solver.deflection.forward import greatest_deviation
from jointstiff.solver.deflection.joint_model import JointModel
from jointstiff.solver.deflection.load_cases import LoadCases
from jointstiff.solver.errors import RequestError
from jointstiff.solver.fitting.settings import Settings
from jointstiff.solver.inference.budget import LeftOut
from jointstiff.solver.inference.estimate import Estimate
from jointstiff.solver.readings.measurements import Measurements
from jointstiff.solver.resampling import blocks_of_identified, fit_subsets
from jointstiff.solver.robot.model import Robot

MOST_LEFT_OUT: Final = 200
"""Postures that are left out, evenly spread over a larger set."""
MOST_STEPS: Final = 500
"""Steps of the distribution of scores that are kept: a quantile is rounded up by at most 0.2 %."""
_SAME_POSTURE: Final = 1e-6
"""Difference of joint angles [rad] below which two observations share a posture."""
_SLACK: Final = 1e-9


@dataclass(frozen=True, eq=False)
class ModelErrorBound:
    """Radii of balls about B predicted displacements, to hold the truth with the model error."""

    radius: FloatArray  #: (B,) [m]; inf where nothing can be said
    #: `force` or `moment` if no load of the campaign had one: under one, nothing can be said
    unmeasured: str | None
    #: (B,) size of the load over the greatest that was measured; above 1 it is extrapolated
    load_ratio: FloatArray
    #: (B,) how much less the readings say of the place under that load than of the worst target that was
    #: read; above 1 it is extrapolated. Both widen the ball.
    leverage_ratio: FloatArray

    def interval(self, displacement: FloatArray, of_readings: FloatArray | None) -> FloatArray:
        """(B, 3, 2) of displacements (B, 3) [m]: the balls, and what the readings (B, 6, 2) leave open."""
        half = self.radius[:, None, None] * np.array([-1.0, 1.0])
        ends: FloatArray = displacement[..., None] + half
        if of_readings is None:
            return ends
        lower = np.minimum(ends[..., 0], of_readings[:, :3, 0])
        return np.stack([lower, np.maximum(ends[..., 1], of_readings[:, :3, 1])], axis=-1)


@dataclass(frozen=True, eq=False)
class ModelError:
    """Residuals of readings in postures that were left out of the fit."""

    postures: int  #: number P of postures that it rests on
    #: (S,) ascending: length of a residual over the root of the size of its load [m], less what is the
    #: readings' own in it; inf where the others do not determine it
    score: FloatArray
    share: FloatArray  #: (S,) share of the postures' readings with that score at most, times P/(P + 1)
    force: float  #: unit of the size of a load [N]; zero where none was measured
    moment: float  #: likewise [N·m]; zero where none was measured. In both the greatest load has size 1.
    least_load: float  #: least size of a load
    leverage: float  #: greatest ``√λ_max(A C Aᵀ)`` of a target over the size of its load [m]
    left_out: LeftOut | None = None  #: the fits without each posture; None where they are not known

    @staticmethod
    def needed(confidence: float) -> int:
        """Return the least number of postures: below ``⌈1/α⌉ − 1`` no bound holds."""
        return ceil(1.0 / (1.0 - confidence) - _SLACK) - 1

    def load_size(self, force: FloatArray, moment: FloatArray) -> FloatArray:
        """(B,) ``|F|/force + |M|/moment`` of loads (B, 3); inf for what was not measured."""
        size = np.zeros(len(force))
        for vector, greatest in ((force, self.force), (moment, self.moment)):
            length = np.linalg.norm(vector, axis=1)
            with np.errstate(divide="ignore", invalid="ignore"):
                size += np.where(length > 0.0, length / greatest, 0.0)
        return size

    def quantile(self, confidence: float) -> float:
        """Return the score that a new posture's is to stay below [m]; inf where nothing can be said."""
        place = int(np.searchsorted(self.share, confidence - _SLACK))
        return float(self.score[place]) if place < len(self.score) else float("inf")

    def bound(self, cases: LoadCases, leverage: FloatArray, confidence: float) -> ModelErrorBound:
        """Return the bound at predicted places whose displacements have a leverage (B,) [m].

        Within the campaign's loads it grows with the root of the load: what is not modelled is part elastic,
        part friction. An extrapolated load or posture widens it in proportion.
        """
        load = self.load_size(cases.force, cases.moment)
        with np.errstate(divide="ignore", invalid="ignore"):
            ratio = np.where(
                leverage > 0.0, leverage / (np.where(load > 0.0, load, 1.0) * self.leverage), 0.0
            )
        growth = np.maximum(np.sqrt(np.maximum(load, self.least_load)), load) * np.maximum(ratio, 1.0)
        radius = self.quantile(confidence) * growth
        unmeasured = "force" if self.force == 0.0 else "moment" if self.moment == 0.0 else None
        return ModelErrorBound(radius, unmeasured, load, ratio)


def leave_postures_out(
    robot: Robot, measurements: Measurements, settings: Settings, estimate: Estimate, model: JointModel
) -> ModelError:
    """Refit without each posture in turn, and compare what is predicted there with what was read.

    The refits use method, weighting and bounds of the run, the weights of its robust loss, and K_c at its
    compliances; priors and an order are left out of them, so that residuals are greater rather than less.

    Raises:
        RequestError: no posture can be left out.
        JointstiffError: as the refits do.
    """
    summary, load = _measured_loads(measurements)
    groups, postures = _postures(measurements, load > 0.0)
    if len(groups) < 2:
        raise _too_few()
    if measurements.direction is not None:
        raise RequestError(
            "readings along a direction do not show how far a prediction is off",
            remedy="read all three coordinates of a target",
        )
    if estimate.covariance is None:
        raise RequestError(
            "the uncertainty of the readings is unknown", remedy="measure more postures, or state `noise`"
        )
    if estimate.robust is not None:
        measurements = estimate.robust.weigh(measurements)
    plain = replace(settings, loss="squared", prior=None, order=())
    blocks = blocks_of_identified(robot, measurements, plain, estimate)
    observation = np.nonzero(measurements.present)[0]  # of each reading
    left_out = np.full(len(measurements), -1, dtype=np.intp)
    for p, group in enumerate(groups):
        left_out[group] = p
    others = (left_out != np.arange(len(groups))[:, None]).astype(np.float64)
    fits = fit_subsets(blocks, others, plain.bounds)[0]
    # Leverages of all readings under load, also of postures that stay in every fit.
    loaded = np.flatnonzero(load[observation] > 0.0)
    size, posture = load[observation[loaded]], left_out[observation[loaded]]
    half = blocks.regressor[..., loaded].transpose(2, 1, 0) @ model.root[blocks.visible]
    read = posture >= 0
    compliance = fits[posture[read]][:, blocks.visible]
    predicted = np.einsum("rv,vir->ir", compliance, blocks.regressor[..., loaded[read]])
    squares = np.square(blocks.deflection[:, loaded[read]] - predicted).sum(axis=0)
    variance = np.square(half[read]).sum(axis=(1, 2))
    noise = _reading_variance(measurements)[loaded[read]] + variance / (postures - 1)
    error = _with_scores(summary, size[read], posture[read], squares, noise)
    greatest = float((greatest_deviation(half) / size).max())
    return replace(error, leverage=greatest, left_out=LeftOut(fits, postures))


def leave_folds_out(
    measurements: Measurements,
    parts: Sequence[IndexArray],
    residuals: Sequence[FloatArray],
    halves: Sequence[FloatArray],
) -> ModelError:
    """Compare what fits to all parts but one predict there with what was read.

    Args:
        measurements: N observations.
        parts: the observations of each part.
        residuals: (R, 3) of the readings of each part, by the fit to the others [m].
        halves: (R, 3, p) roots of the covariances of these predictions [m]; zero if they are unknown.

    Raises:
        RequestError: nothing loads the robot.
    """
    summary, load = _measured_loads(measurements)
    _, posture = np.unique(measurements.joints, axis=0, return_inverse=True)
    of_reading = np.nonzero(measurements.present)[0]
    order = np.concatenate([np.flatnonzero(np.isin(of_reading, part)) for part in parts])
    lacked = np.concatenate([np.full(len(part), len(part) / len(measurements)) for part in parts])
    loaded = load[of_reading[order]] > 0.0
    order, half = order[loaded], np.concatenate(halves)[loaded]
    observation = of_reading[order]
    squares = np.square(np.concatenate(residuals)[loaded]).sum(axis=1)
    variance = np.square(half).sum(axis=(1, 2))
    share = lacked[np.argsort(np.concatenate(parts))][observation]
    noise = _reading_variance(measurements)[order] + share * variance
    size = load[observation]
    error = _with_scores(summary, size, posture.reshape(-1)[observation], squares, noise)
    return replace(error, leverage=float((greatest_deviation(half) / size).max()))


def _reading_variance(measurements: Measurements) -> FloatArray:
    """Return the expected square of the noise of each reading (R,) as stated [m²]; zero if it is not."""
    trace = np.trace(measurements.covariance, axis1=-2, axis2=-1)
    sigma = measurements.sigma or 0.0
    return np.asarray(sigma**2 * np.broadcast_to(trace, measurements.present.shape)[measurements.present])


def _measured_loads(measurements: Measurements) -> tuple[ModelError, FloatArray]:
    """Return a model error without scores, whose greatest load has size 1, and the sizes (N,) of the loads.

    Raises:
        RequestError: nothing loads the robot.
    """
    force, moment = (np.linalg.norm(v, axis=1).max() for v in (measurements.force, measurements.moment))
    if not (force or moment):
        raise _too_few()
    summary = ModelError(0, np.zeros(0), np.zeros(0), float(force), float(moment), 0.0, 0.0)
    greatest = float(summary.load_size(measurements.force, measurements.moment).max())
    summary = replace(summary, force=greatest * float(force), moment=greatest * float(moment))
    load = summary.load_size(measurements.force, measurements.moment)
    return replace(summary, least_load=float(load[load > 0.0].min())), load


def _with_scores(
    summary: ModelError, size: FloatArray, posture: IndexArray, squares: FloatArray, noise: FloatArray
) -> ModelError:
    """Return a model error with the scores of R readings, without what is the readings' own in them.

    A residual is the sum of the prediction's error and of the reading's own, which no ball about a prediction
    has to hold. Their squares add up in the mean only: all scores shrink alike, so that quantiles keep
    their order. That mean is known to a standard error, by which less is taken off.

    Args:
        summary: unit of the loads.
        size: (R,) of the readings' loads.
        posture: (R,) index of each reading's posture.
        squares: (R,) of the residuals [m²]; NaN where undetermined.
        noise: (R,) expected square of the reading's error, and of that of the prediction for the readings
            that its fit lacks [m²].
    """
    known = np.isfinite(squares)
    of_load, left = squares / size, 1.0
    if known.any() and (whole := float(of_load[known].mean())) > 0.0:
        counts = np.bincount(posture[known])
        means = np.bincount(posture[known], of_load[known])[counts > 0] / counts[counts > 0]
        error = float(means.std(ddof=1)) / np.sqrt(len(means)) if len(means) > 1 else whole
        left = min(1.0, max(0.0, 1.0 - float((noise / size)[known].mean()) / whole) + error / whole)
    score = np.sqrt(np.where(known, left * of_load, np.inf))
    steps, share = merged_steps(posture, score)
    return replace(
        summary,
        postures=len(np.unique(posture)),
        score=steps,
        share=share,
    )


def _too_few() -> RequestError:
    return RequestError("the model error needs two postures under load", remedy="measure more postures")


def merged_steps(posture: IndexArray, score: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return what quantiles need of the scores, in about `MOST_STEPS` steps.

    Args:
        posture: (R,) index of each reading's posture.
        score: (R,) its score.

    Returns:
        (S,) ascending scores, each the greatest of those that it stands for, and (S,) their shares.
    """
    postures, index, counts = np.unique(posture, return_inverse=True, return_counts=True)
    order = np.argsort(score, kind="stable")
    share = np.cumsum(1.0 / counts[index[order]]) / (len(postures) + 1)
    if len(order) > MOST_STEPS:
        last = np.diff(np.ceil(MOST_STEPS * share), append=np.inf) > 0.0
        order, share = order[last], share[last]
    return score[order], share


def _postures(measurements: Measurements, loaded: BoolArray) -> tuple[list[IndexArray], int]:
    """Observations by posture, at most `MOST_LEFT_OUT` of the loaded ones, and the number of all these."""
    rounded = np.round(measurements.joints / _SAME_POSTURE)
    order = np.lexsort(rounded.T[::-1])
    groups = np.split(order, np.flatnonzero(np.diff(rounded[order], axis=0).any(axis=1)) + 1)
    groups = [group for group in groups if loaded[group].any()]
    count = len(groups)
    if count > MOST_LEFT_OUT:
        groups = [groups[k] for k in np.linspace(0, count - 1, MOST_LEFT_OUT).astype(int)]
    return groups, count
