"""Deflections of a tool along a path, and comparison of two ways.

Two ways are ranked by the interval of the *difference* of their deflections. Errors of the compliances and of
the force are common to both ways, so that they cancel to a large part. The model error, such as of links that
bend although the model has none, is known from postures that were held out: its spread along a direction
counts once for each way, as common to all points of the way, and as independent of the other way. In
simulations with such links the true difference is in its interval in more than 99 % of the cases, and the
interval from the readings alone is in the wrong order in 6 %; see `benchmarks/studies/ways.py`.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from math import hypot

import numpy as np

from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.errors import RequestError
from jointstiff.solver.fit.stages import student_quantile
from jointstiff.solver.mechanics.cases import LoadCases
from jointstiff.solver.predict.forward import Deflection, ForwardModel, unit_vectors
from jointstiff.solver.predict.models import ModelError


@dataclass(frozen=True)
class Band:
    """A value with its intervals at a level of confidence; an interval is None if it is unknown."""

    value: float
    readings: tuple[float, float] | None  #: by the errors of readings and forces
    with_model_error: tuple[float, float] | None  #: by the model error, too


@dataclass(frozen=True)
class Ranking:
    """Comparison of one way with another: whether its deflection is less."""

    difference: Band  #: of the deflections, the first minus the second [m]

    @property
    def is_ordered(self) -> bool:
        """Return whether the interval with the model error is known and excludes zero."""
        interval = self.difference.with_model_error
        return interval is not None and not interval[0] <= 0.0 <= interval[1]

    @property
    def first_is_less(self) -> bool:
        """Return whether the first way surely has less deflection than the second."""
        return self.is_ordered and self.difference.value < 0.0


@dataclass(frozen=True, eq=False)
class PathDeflection:
    """Exact deflections at the m points of a path, and how the errors of readings and forces change them."""

    model: ForwardModel
    displacement: FloatArray  #: (m, 3) displacements of the tool's centre, axes of R0 [m]
    weights: FloatArray  #: (m,) weights of the points, with the sum 1; zero for points that do not count
    #: (m, 3, r) effects of r independent errors of unit variance, of readings then forces [m]; None if the
    #: uncertainty of the readings is unknown
    effects: FloatArray | None
    radius: FloatArray  #: (m,) bound of the model error [m]; NaN where it has none
    #: (m,) standard deviation of the model error along a direction [m]; NaN where it is unknown
    deviation: FloatArray
    freedom: int | None  #: degrees of freedom of `deviation`; None if it is known without error
    #: (m,) ratio of load or leverage to the campaign's greatest; NaN without a model error
    extrapolation: FloatArray
    greatest: bool  #: whether `size` is the greatest deflection, and not the root mean square

    @classmethod
    def predict(
        cls,
        model: ForwardModel,
        error: ModelError | None,
        cases: LoadCases,
        *,
        is_prior: bool = False,
        force_parts: FloatArray | None = None,
        confidence: float = 0.95,
        greatest: bool = False,
        weights: FloatArray | None = None,
    ) -> PathDeflection:
        """Predict the deflections along a path.

        Args:
            model: model of the loaded robot.
            error: error of the model; None if it is unknown.
            cases: m points: postures, loads and places.
            is_prior: whether the covariance of the model already contains its error, as that of a prior.
            force_parts: (m, 3, 3) standard errors of the force, three independent vectors at each point that
                are common to all points, axes of R0 [N]; None for forces without an error.
            confidence: level of the bound of the model error.
            greatest: whether the greatest deflection counts in place of the root mean square.
            weights: (m,) weights of the points; None for equal weights of the points with a load, or of all.

        Raises:
            RequestError: a load has no stable equilibrium, or twists a joint of unknown compliance.
        """
        unloaded = model.unloaded(cases)
        bent = model.deflect(cases, unloaded)
        _refuse_unseen(bent)
        radius = extrapolation = np.full(len(cases), np.nan)
        deviation, freedom = np.full(len(cases), 0.0 if is_prior else np.nan), None
        if error is not None:
            bound = error.bound(cases, bent.leverage, confidence)
            radius = np.where(np.isfinite(bound.radius), bound.radius, np.nan)
            deviation = np.where(np.isfinite(bound.deviation), bound.deviation, np.nan)
            extrapolation, freedom = np.maximum(bound.load_ratio, bound.leverage_ratio), error.postures - 1
        effects = None if bent.covariance_root is None else bent.covariance_root[:, :3]
        if effects is not None and force_parts is not None:
            by_force = np.stack(
                [
                    model.linear_displacement(
                        LoadCases(
                            cases.joints.copy(),
                            force_parts[:, :, k].copy(),
                            np.zeros_like(cases.force),
                            cases.load_point.copy(),
                            cases.place.copy(),
                        ),
                        unloaded,
                    )
                    for k in range(3)
                ],
                axis=2,
            )
            effects = np.concatenate([effects, by_force], axis=2)
        if weights is None:
            loaded = np.asarray(cases.force.any(axis=1) | cases.moment.any(axis=1))
            counted = loaded if loaded.any() else np.ones(len(cases), dtype=np.bool_)
            weights = counted / counted.sum()
        return cls(
            model,
            bent.displacement,
            weights,
            effects,
            radius,
            deviation,
            freedom,
            extrapolation,
            greatest,
        )

    @cached_property
    def length(self) -> FloatArray:
        """(m,) lengths of the deflections [m]."""
        return np.asarray(np.linalg.norm(self.displacement, axis=1))

    @cached_property
    def _weights(self) -> FloatArray:
        """(m, 3) derivative of `size` with respect to the displacement at each point."""
        weights = np.zeros_like(self.displacement)
        if self.greatest:
            worst = int(np.argmax(np.where(self.weights > 0.0, self.length, -1.0)))
            weights[worst] = unit_vectors(self.displacement[worst : worst + 1])[0]
        elif self.size > 0.0:
            weights = self.weights[:, None] * self.displacement / self.size
        return weights

    @cached_property
    def size(self) -> float:
        """Root mean square, or greatest value, of the deflections at the points under load [m]."""
        return self._mean(self.length)

    @cached_property
    def effect(self) -> FloatArray | None:
        """(r,) effects of the independent errors on `size` [m]; None if unknown."""
        return None if self.effects is None else np.einsum("bi,bir->r", self._weights, self.effects)

    def _sum_errors(self, of_point: FloatArray) -> float:
        """Return the error of `size` from errors (m,) of the points, if all agree [m]; NaN if unknown."""
        weight = np.linalg.norm(self._weights, axis=1)
        return float((weight * np.where(weight > 0.0, of_point, 0.0)).sum())

    def band(self, confidence: float) -> Band:
        """Return `size` with its intervals at a level of confidence."""
        half = self._half_width(self.effect, confidence)
        return _make_band(self.size, half, self._sum_errors(self.radius), least=0.0)

    def bands(self, confidence: float) -> tuple[FloatArray, FloatArray]:
        """Return intervals (m, 2) of the lengths [m], by readings and forces, and with the model error.

        NaN where an interval is unknown.
        """
        half = np.full(len(self.length), np.nan)
        if self.effects is not None:
            along = np.einsum("bi,bir->br", unit_vectors(self.displacement), self.effects)
            half = self.model.quantile(confidence) * np.linalg.norm(along, axis=1)
        wide = np.where(np.isnan(self.radius), np.nan, np.fmax(half, self.radius))
        near, far = (
            np.stack([np.maximum(self.length - each, 0.0), self.length + each], axis=1)
            for each in (half, wide)
        )
        return near, far

    def remaining(self, residual: FloatArray, share: FloatArray, confidence: float) -> Band:
        """Return the deflection that is left after a correction by these predictions, with its intervals.

        The value is what the prediction leaves; the intervals reach up to the errors of the prediction, in
        proportion to the fraction that is corrected.

        Args:
            residual: (m,) predicted distances of the loaded tool from its targets [m].
            share: (m,) fraction of the full correction that each command contains.
            confidence: level of the intervals.
        """
        value = self._mean(residual)
        half, wide = (self._mean(each) for each in self._remaining_errors(share, confidence))
        band = _make_band(value, half, wide, 0.0)
        return Band(
            value,
            *(None if each is None else (0.0, each[1]) for each in (band.readings, band.with_model_error)),
        )

    def remaining_bands(
        self, residual: FloatArray, share: FloatArray, confidence: float
    ) -> tuple[FloatArray, FloatArray]:
        """Return intervals (m, 2) of what is left at each point [m], as `bands` does; see `remaining`."""
        half, wide = self._remaining_errors(share, confidence)
        near, far = (
            np.stack([np.where(np.isnan(each), np.nan, 0.0), residual + each], axis=1)
            for each in (half, np.where(np.isnan(wide), np.nan, np.fmax(half, wide)))
        )
        return near, far

    def _remaining_errors(self, share: FloatArray, confidence: float) -> tuple[FloatArray, FloatArray]:
        """Return errors (m,) of corrected points by the readings and of the model [m]; NaN if unknown."""
        half = np.full(len(share), np.nan)
        if self.effects is not None:
            deviation = np.sqrt(np.square(self.effects).sum(axis=(1, 2)))
            half = self.model.quantile(confidence) * share * deviation
        return half, share * self.radius

    def _mean(self, lengths: FloatArray) -> float:
        """Return the root mean square, or the greatest, of lengths (m,) at the points that count."""
        counted = self.weights > 0.0
        if self.greatest:
            return float(lengths[counted].max())
        return float(np.sqrt(self.weights[counted] @ np.square(lengths[counted])))

    def compare(self, other: PathDeflection, confidence: float) -> Ranking:
        """Compare this way with another: the interval of the difference of their sizes.

        Errors of readings and forces are common to both ways. The model errors of the ways are independent
        of each other, and common to all points of a way; a way that is the other way has the same model
        error. The interval with the model error is unknown if the spread of the model error is.
        """
        effect = None if self.effect is None or other.effect is None else self.effect - other.effect
        half = self._half_width(effect, confidence)
        deviation = hypot(self._sum_errors(self.deviation), other._sum_errors(other.deviation))
        if effect is not None and not effect.any() and np.array_equal(self.deviation, other.deviation):
            deviation = 0.0
        wide = hypot(half, student_quantile(0.5 * (1.0 + confidence), self.freedom) * deviation)
        return Ranking(_make_band(self.size - other.size, half, wide))

    def _half_width(self, effect: FloatArray | None, confidence: float) -> float:
        """Return the half-width of an interval from the effects (r,) of errors [m]; NaN if unknown."""
        if effect is None:
            return float("nan")
        return self.model.quantile(confidence) * float(np.linalg.norm(effect))


def _make_band(value: float, half: float, model_error: float, least: float = -np.inf) -> Band:
    """Return a value with two intervals; the interval with model error contains the other."""
    wide = float(np.fmax(half, model_error)) if np.isfinite(model_error) else float("nan")
    readings, with_error = (
        None if np.isnan(each) else (max(value - each, least), value + each) for each in (half, wide)
    )
    return Band(value, readings, with_error)


def _refuse_unseen(bent: Deflection) -> None:
    """Raise a `RequestError` if the load twists a joint whose compliance the readings do not determine."""
    if bent.unseen.any():
        twisted = ", ".join(np.array(bent.model.robot.joint_names)[bent.unseen.any(axis=0)])
        raise RequestError(
            f"the load or own weight twists {twisted}, but the readings do not determine the stiffness there",
            where="run_id",
            remedy="choose a run whose readings determine every joint that the process loads",
        )
