"""Model error: an empirical bound from postures held out, one after the other (method.md §11).

Vovk, Gammerman & Shafer, *Algorithmic Learning in a Random World*, 2005: if a new posture is exchangeable
with those measured, its score lies among theirs as likely at one place as at another. The targets of a
posture share its place (Lee, Barber & Willett, *Distribution-free inference with hierarchical data*, 2023).
Here each score is of a fit of its own, so the argument is no proof: residuals of held-out postures
have no guarantee without assumptions on their distribution (Barber, Candès, Ramdas & Tibshirani, *Predictive
inference with the jackknife+*, 2021).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import ceil
from typing import Final

import numpy as np

from jointstiff.schemas.options import CrossValidation
from jointstiff.solver.arrays import FloatArray, IndexArray
from jointstiff.solver.errors import RequestError
from jointstiff.solver.evidence.estimate import Estimate, LeftOut
from jointstiff.solver.fitting.method import Settings
from jointstiff.solver.links.choice import Folds, fit_fold
from jointstiff.solver.links.fit import ElasticEstimate
from jointstiff.solver.links.model import elastic_blocks
from jointstiff.solver.predict.forward import LoadCases, greatest_deviation
from jointstiff.solver.predict.models import ElasticPredictor, JointModel
from jointstiff.solver.readings.measurements import Measurements
from jointstiff.solver.resampling import fit_subsets, gram_blocks
from jointstiff.solver.robot.model import Robot
from jointstiff.solver.triangle import whitened

MOST_LEFT_OUT: Final = 200
"""Postures that are left out, evenly spread over a larger set."""
MOST_STEPS: Final = 500
"""Steps of the distribution of scores that are kept: a quantile is rounded up by at most 0.2 %."""
_PARTS: Final = 20
"""Parts of the postures that are left out in turn where links bend."""
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
    #: (S,) ascending: length of a residual over its growth, the root of the size of its load or that of
    #: `noise` [m], less what is the readings' own in it; inf where the others do not determine it
    score: FloatArray
    share: FloatArray  #: (S,) share of the postures' readings with that score at most, times P/(P + 1)
    force: float  #: unit of the size of a load [N]; zero where none was measured
    moment: float  #: likewise [N·m]; zero where none was measured. In both the greatest load has size 1.
    least_load: float  #: least size of a load
    leverage: float  #: greatest ``√λ_max(A C Aᵀ)`` of a target over the size of its load [m]
    #: standard deviation of a coordinate of a reading, by the residuals where links bend: a residual grows
    #: with it and the leverage [m]; None where noise is stated or nothing but joints bends, and a residual
    #: grows with the root of the load
    noise: float | None = None
    left_out: LeftOut | None = None  #: the fits without each posture; None where they are not known

    @staticmethod
    def needed(confidence: float) -> int:
        """Return the least number of postures: below ``⌈1/α⌉ − 1`` no bound holds."""
        return ceil(1.0 / (1.0 - confidence) - _SLACK) - 1

    def quantile(self, confidence: float) -> float:
        """Return the score that a new posture's is to stay below [m]; inf where nothing can be said."""
        place = int(np.searchsorted(self.share, confidence - _SLACK))
        return float(self.score[place]) if place < len(self.score) else float("inf")

    def bound(self, cases: LoadCases, leverage: FloatArray, confidence: float) -> ModelErrorBound:
        """Return the bound at predicted places whose displacements have a leverage (B,) [m].

        Within the campaign's loads it grows with the root of the load: what joints alone do not model is
        part elastic, part friction. Where links bend and no noise is stated, noise remains, and what the
        readings leave open: it grows as the standard deviation of a reading. An extrapolated load or posture
        widens it in proportion.
        """
        load = load_sizes(cases.force, cases.moment, self.force, self.moment)
        with np.errstate(divide="ignore", invalid="ignore"):
            ratio = np.where(
                leverage > 0.0, leverage / (np.where(load > 0.0, load, 1.0) * self.leverage), 0.0
            )
        growth = _growth(np.maximum(load, self.least_load), leverage, self.noise) * np.maximum(ratio, 1.0)
        radius = self.quantile(confidence) * growth
        unmeasured = "force" if self.force == 0.0 else "moment" if self.moment == 0.0 else None
        return ModelErrorBound(radius, unmeasured, load, ratio)


def _growth(load: FloatArray, leverage: FloatArray, noise: float | None) -> FloatArray:
    """Return by how much residuals grow (B,) with loads of sizes (B,) and leverages (B,) [m].

    That is 1 without leverage, or at the greatest load where no noise (`ModelError.noise`) is known.
    """
    if noise is None:
        return np.maximum(np.sqrt(load), load)
    return np.hypot(np.maximum(load, 1.0), leverage / noise)


def load_sizes(force: FloatArray, moment: FloatArray, most_force: float, most_moment: float) -> FloatArray:
    """Return ``|F|/most_force + |M|/most_moment`` (B,) of loads (B, 3); inf for what was not measured."""
    size = np.zeros(len(force))
    for vector, greatest in ((force, most_force), (moment, most_moment)):
        length = np.linalg.norm(vector, axis=1)
        with np.errstate(divide="ignore", invalid="ignore"):
            size += np.where(length > 0.0, np.divide(length, greatest), 0.0)
    return size


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
    rounded = np.round(measurements.joints / _SAME_POSTURE)
    posture = np.unique(rounded, axis=0, return_inverse=True)[1].reshape(-1)
    loaded = (measurements.force != 0.0).any(axis=1) | (measurements.moment != 0.0).any(axis=1)
    groups = np.unique(posture[loaded])
    count = len(groups)
    if count < 2:
        raise RequestError("the model error needs two postures under load", remedy="measure more postures")
    if measurements.direction is not None:
        raise RequestError(
            "readings along a direction do not show how far a prediction is off",
            remedy="read all three coordinates of a target",
        )
    if estimate.covariance is None:
        raise RequestError(
            "the uncertainty of the readings is unknown", remedy="measure more postures, or state `noise`"
        )
    if count > MOST_LEFT_OUT:
        groups = groups[np.linspace(0, count - 1, MOST_LEFT_OUT).astype(int)]
    if estimate.robust is not None:
        measurements = estimate.robust.weigh(measurements)
    plain = replace(settings, loss="squared", prior=None, order=())
    blocks = gram_blocks(robot, measurements, plain, estimate)
    fits = fit_subsets(blocks, (posture != groups[:, None]).astype(np.float64), plain.bounds)[0]
    of_reading = posture[np.nonzero(measurements.present)[0]]
    left_out = np.isin(of_reading, groups)
    compliance = np.zeros((len(of_reading), len(blocks.visible)))
    compliance[left_out] = fits[np.searchsorted(groups, of_reading[left_out])][:, blocks.visible]
    residual = blocks.deflection.T - np.einsum("rv,vir->ri", compliance, blocks.regressor)
    half = blocks.regressor.transpose(2, 1, 0) @ model.root[blocks.visible]
    lacking = np.full(len(of_reading), 1.0 / (count - 1))
    error = _model_error(measurements, np.where(left_out, of_reading, -1), residual, half, lacking)
    return replace(error, left_out=LeftOut(fits, count))


def leave_folds_out(robot: Robot, measurements: Measurements, elastic: ElasticEstimate) -> ModelError:
    """Return the model error by the postures of `_PARTS` parts, each predicted by a fit to the others.

    So many leave hardly smaller sets to fit than the whole. Without the readings of a part, whitened rows A,
    the covariance ``C = L Lᵀ`` is ``L (I − Lᵀ AᵀA L)⁻¹ Lᵀ``.

    Raises:
        UnsupportedMethodError: there is one posture only.
    """
    model, sigma = ElasticPredictor.of(robot, elastic), elastic.companion.sigma
    parts = CrossValidation(folds=_PARTS, draws=1)
    folds = Folds(robot, measurements, elastic.model.columns, model.seen, parts)
    covariance = np.broadcast_to(measurements.covariance, (*measurements.present.shape, 3, 3))
    of_reading = np.nonzero(measurements.present)[0]
    residual, lacking = np.empty((len(of_reading), 3)), np.empty(len(of_reading))
    half = np.zeros((len(of_reading), 3, 1 if model.root is None else len(model.root)))
    for number, part in enumerate(folds.held_out):
        compliances, _ = fit_fold(folds, elastic.model, number, (elastic.penalty,))
        blocks = elastic_blocks(robot, measurements[part], folds.columns)
        rows = np.concatenate([columns[block.measurements.present] for block, columns in blocks])
        own = np.flatnonzero(np.isin(of_reading, part))
        residual[own] = rows[..., -1] - rows[..., :-1] @ compliances[0]
        lacking[own] = len(part) / len(measurements)
        if model.root is not None and sigma is not None:
            root = rows[..., model.kept] @ model.root
            known = whitened(sigma**2 * covariance[part][measurements.present[part]], root)
            known = known.reshape(-1, known.shape[-1])
            factor = np.linalg.cholesky(np.eye(known.shape[1]) - known.T @ known)
            half[own] = root @ np.linalg.inv(factor).T
    posture = np.unique(measurements.joints, axis=0, return_inverse=True)[1].reshape(-1)
    variance = float(np.trace(covariance, axis1=-2, axis2=-1)[measurements.present].mean()) / 3.0
    # A stated sigma is taken off the scores.
    noise = sigma * np.sqrt(variance) if sigma and measurements.sigma is None else None
    return _model_error(measurements, posture[of_reading], residual, half, lacking, noise)


def _model_error(
    measurements: Measurements,
    posture: IndexArray,
    residual: FloatArray,
    half: FloatArray,
    lacking: FloatArray,
    noise: float | None = None,
) -> ModelError:
    """Return the model error by R readings, without what is the readings' own in it.

    A residual is the sum of the prediction's error and of the reading's own, which no ball about a prediction
    has to hold. Their squares add up in the mean only: all scores shrink alike, so that quantiles keep
    their order. That mean is known to a standard error, by which less is taken off.

    Args:
        measurements: N observations.
        posture: (R,) index of each reading's posture; −1 where that was not left out.
        residual: (R, 3) of the readings by fits without their postures [m]; NaN where undetermined.
        half: (R, 3, p) roots of the covariances of predictions [m]; zero if they are unknown.
        lacking: (R,) share of that covariance that the fit without the posture has more.
        noise: as `ModelError.noise`.
    """
    of_reading = np.nonzero(measurements.present)[0]
    force, moment = (
        float(np.linalg.norm(each, axis=1).max()) for each in (measurements.force, measurements.moment)
    )
    load = load_sizes(measurements.force, measurements.moment, force, moment)
    greatest = float(load.max())
    load = load / greatest
    loaded = load[of_reading] > 0.0
    deviation = greatest_deviation(half)
    scored = np.flatnonzero(loaded & (posture >= 0))
    posture, size = posture[scored], np.square(_growth(load[of_reading[scored]], deviation[scored], noise))
    trace = np.trace(measurements.covariance, axis1=-2, axis2=-1)
    variance = np.broadcast_to(trace, measurements.present.shape)[measurements.present][scored]
    own = (measurements.sigma or 0.0) ** 2 * variance
    own = own + lacking[scored] * np.square(half[scored]).sum(axis=(1, 2))
    squares, left = np.square(residual[scored]).sum(axis=1) / size, 1.0
    known = np.isfinite(squares)
    if known.any() and (whole := float(squares[known].mean())) > 0.0:
        counts = np.bincount(posture[known])
        means = np.bincount(posture[known], squares[known])[counts > 0] / counts[counts > 0]
        error = float(means.std(ddof=1)) / np.sqrt(len(means)) if len(means) > 1 else whole
        left = min(1.0, max(0.0, 1.0 - float((own / size)[known].mean()) / whole) + error / whole)
    score, share = merged_steps(posture, np.sqrt(np.where(known, left * squares, np.inf)))
    return ModelError(
        postures=len(np.unique(posture)),
        score=score,
        share=share,
        force=greatest * force,
        moment=greatest * moment,
        least_load=float(load[load > 0.0].min()),
        leverage=float((deviation[loaded] / load[of_reading[loaded]]).max()),
        noise=noise,
    )


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
