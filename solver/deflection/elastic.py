"""Prediction by a model in which links bend, to first order in the load (method.md §9).

The covariance is that of Bayesian least squares: the readings, and a normal prior of the penalised entries
about zero, whose standard deviation is half the root mean square of the elements' traces, in the penalty's
units. The cone is left out. What the readings leave open is bounded by how much the links bend at all.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final

import numpy as np
from scipy import special
from scipy.linalg import solve_triangular

from jointstiff.solver.arrays import BoolArray, FloatArray, IndexArray
from jointstiff.solver.convex.semidefinite.symmetric import diagonal
from jointstiff.solver.deflection.cartesian import CartesianCompliance
from jointstiff.solver.deflection.load_cases import LoadCases
from jointstiff.solver.deflection.loaded import LoadedPosture
from jointstiff.solver.deflection.model_error import ModelError, merged_steps
from jointstiff.solver.deflection.prediction import Deflection
from jointstiff.solver.errors import RequestError
from jointstiff.solver.links.cross_validation import FoldFit, Folds
from jointstiff.solver.links.estimate import Companion, ElasticEstimate
from jointstiff.solver.links.places import ElasticPlaces, elastic_residuals
from jointstiff.solver.links.regressor import ElasticColumns
from jointstiff.solver.readings.measurements import Measurements
from jointstiff.solver.robot.configuration import Configurations
from jointstiff.solver.robot.model import Robot

_SHARE_OF_TRACE: Final = 0.5
"""Prior standard deviation of an entry relative to the elements' root mean square trace: on exact beams held
out, 95 % intervals of displacements then hold 97 % (20 and 40 postures) and 95 % (100) of the truth."""
_JOINT_PRIOR: Final = 10.0
"""Prior standard deviation of a joint's compliance, in units of what would explain all deflections."""
_LEAST_PRIOR: Final = 1e-6
"""Likewise of an entry at the least, where no element bends."""


@dataclass(frozen=True, eq=False)
class ElasticPredictor:
    """A robot whose links bend."""

    robot: Robot  #: n joints
    columns: ElasticColumns  #: of the richest model
    kept: IndexArray  #: (p,) columns that the model has
    entries: FloatArray  #: (p,) compliances
    #: (p, p) upper triangular, root rootᵀ the covariance of the entries; None if it is unknown
    root: FloatArray | None
    seen: BoolArray  #: (n,) joints that the readings saw
    degrees_of_freedom: float | None  #: of sigma; None for one that was given

    @classmethod
    def of(cls, robot: Robot, elastic: ElasticEstimate) -> ElasticPredictor:
        """Take over what an identification found."""
        companion = elastic.companion
        kept = companion.formulation.columns
        root = None if companion.sigma is None else _root(companion, elastic.entries[kept])
        return cls(
            robot,
            elastic.model.columns,
            kept,
            elastic.entries[kept],
            root,
            ~np.isnan(elastic.compliance),
            companion.degrees_of_freedom,
        )

    def quantile(self, confidence: float) -> float:
        """Return half the width of a two-sided interval in standard uncertainties."""
        probability = 0.5 * (1.0 + confidence)
        if self.degrees_of_freedom is None:
            return float(special.ndtri(probability))
        return float(special.stdtrit(self.degrees_of_freedom, probability))

    @cached_property
    def compliances(self) -> FloatArray:
        """(P,) of all columns of the richest model, zero where this one has none."""
        compliances = np.zeros(self.columns.width)
        compliances[self.kept] = self.entries
        return compliances

    def places(self, cases: LoadCases, unloaded: Configurations) -> ElasticPlaces:
        """Return the places of load cases (B), by their kinematics without the load."""
        load = cases.force, cases.moment, cases.load_point
        return ElasticPlaces.of(self.robot, self.columns, unloaded, load, cases.place)

    def unseen(self, places: ElasticPlaces) -> BoolArray:
        """(B, n) joints that the load twists and of which the readings say nothing."""
        twisted = np.abs(places.jacobian * places.torque[:, None]).max(axis=1) > 0.0
        return np.asarray(twisted & ~self.seen)

    def half(self, places: ElasticPlaces) -> FloatArray | None:
        """(B, 6, p) H, H Hᵀ the covariance of displacement and rotation; None where it is unknown."""
        return None if self.root is None else np.asarray(places.rows[..., self.kept] @ self.root)

    def predict(self, cases: LoadCases, confidence: float) -> Deflection:
        """Predict displacements and rotations, with intervals from the readings alone, and compliance."""
        unloaded = Configurations(self.robot, self.robot.joint_map.model_angles(cases.joints))
        places = self.places(cases, unloaded)
        value = places.deflection(self.compliances)
        covariance = interval = None
        half = self.half(places)
        if half is not None:
            covariance = half @ half.transpose(0, 2, 1)
            spread = self.quantile(confidence) * np.linalg.norm(half, axis=-1)
            interval = value[..., None] + spread[..., None] * np.array([-1.0, 1.0])
        n = self.robot.n
        nothing = np.zeros((len(cases), 6, n))
        return Deflection(
            displacement=value[:, :3],
            rotation=value[:, 3:],
            interval=interval,
            covariance=covariance,
            unseen=self.unseen(places),
            compliance=CartesianCompliance(
                places.compliance(self.compliances),
                np.ones(len(cases), dtype=np.bool_),
                (nothing, nothing),
                None,
            ),
            posture=LoadedPosture.of(self.robot, np.zeros(n), cases),
        )

    def leverage(self, deflection: Deflection) -> FloatArray:
        """(B,) greatest standard uncertainty of a displacement in any direction [m]."""
        if deflection.covariance is None:
            return np.zeros(len(deflection.displacement))
        return _greatest(deflection.covariance[:, :3, :3])


def _root(companion: Companion, entries: FloatArray) -> FloatArray:
    form, x = companion.formulation, entries / companion.formulation.unit
    penalised = x[: form.cone.nonnegative][form.penalised].reshape(-1, 6).sum(axis=1)
    traces = [*penalised, *(x[place][diagonal(size)].sum() for size, place in form.cone.blocks())]
    deviation = max(_SHARE_OF_TRACE * float(np.sqrt(np.mean(np.square(traces)))), _LEAST_PRIOR)
    prior = np.full(len(x), deviation)
    prior[form.joints] = _JOINT_PRIOR
    scaled = form.fit.R * (prior * form.size / float(companion.sigma or 1.0))
    factor = np.linalg.cholesky(scaled.T @ scaled + np.eye(len(x)))
    inverse = solve_triangular(factor, np.eye(len(x)), lower=True)
    return np.asarray((form.unit * prior)[:, None] * inverse.T)


def folds_left_out(
    robot: Robot, measurements: Measurements, folds: Folds, fits: list[FoldFit], model: ElasticPredictor
) -> ModelError:
    """Return the model error by the postures of each fold, predicted by the fits to the other folds.

    Each fit lacks a fold of postures instead of one, so that residuals are greater rather than less.

    Args:
        robot: n joints.
        measurements: N observations.
        folds: of them.
        fits: one a fold, each for one weight of the penalty.
        model: of the whole set.

    Raises:
        RequestError: nothing loads the robot.
    """
    force, moment = (np.linalg.norm(v, axis=1) for v in (measurements.force, measurements.moment))
    units = float(force.max()), float(moment.max())
    if not any(units):
        raise RequestError("it takes two postures under load", remedy="measure more postures")
    summary = ModelError(0, np.zeros(0), np.zeros(0), *units, 0.0, 0.0)
    greatest = float(summary.load_size(measurements.force, measurements.moment).max())
    summary = replace(summary, force=greatest * units[0], moment=greatest * units[1])
    load = summary.load_size(measurements.force, measurements.moment)
    _, index = np.unique(measurements.joints, axis=0, return_inverse=True)
    scores, postures, leverages = [], [], []
    for indices, fit in zip(folds.held_out, fits, strict=True):
        part = measurements[indices]
        residual, rows = elastic_residuals(robot, part, folds.columns, fit.compliances[0])
        observation = indices[np.nonzero(part.present)[0]]
        loaded = load[observation] > 0.0
        root = np.sqrt(load[observation][loaded])
        scores.append(np.linalg.norm(residual[loaded], axis=1) / root)
        postures.append(index.reshape(-1)[observation[loaded]])
        if model.root is not None:
            half = rows[loaded][..., model.kept] @ model.root
            leverages.append(_greatest(half @ half.transpose(0, 2, 1)) / load[observation][loaded])
    posture, score = np.concatenate(postures), np.concatenate(scores)
    steps, share = merged_steps(posture, np.where(np.isnan(score), np.inf, score))
    return replace(
        summary,
        postures=len(np.unique(posture)),
        score=steps,
        share=share,
        least_load=float(load[load > 0.0].min()),
        leverage=float(np.concatenate(leverages).max()) if leverages else 0.0,
    )


def _greatest(covariance: FloatArray) -> FloatArray:
    return np.asarray(np.sqrt(np.maximum(np.linalg.eigvalsh(covariance)[..., -1], 0.0)))
