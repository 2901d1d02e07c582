"""Prediction by a model in which links bend, to first order in the load (method.md §9).

The covariance is that of Bayesian least squares: the readings, and a normal prior of the penalised entries
about zero, whose standard deviation is half the root mean square of the elements' traces, in the penalty's
units. The cone is left out. What the readings leave open is bounded by how much the links bend at all.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
from scipy.linalg import solve_triangular

from jointstiff.solver.arrays import BoolArray, FloatArray, IndexArray
from jointstiff.solver.convex.conic import diagonal
from jointstiff.solver.deflection.cartesian import CartesianCompliance
from jointstiff.solver.deflection.forward import LARGEST_TURN, Deflection, ForwardModel
from jointstiff.solver.deflection.load_cases import LoadCases
from jointstiff.solver.deflection.model_error import ModelError, leave_folds_out
from jointstiff.solver.errors import RequestError
from jointstiff.solver.links.choice import Folds, Plan, fit_fold
from jointstiff.solver.links.fit import Companion, ElasticEstimate
from jointstiff.solver.links.model import ElasticColumns
from jointstiff.solver.links.places import ElasticPlaces, elastic_residuals
from jointstiff.solver.readings.measurements import Measurements
from jointstiff.solver.robot.configuration import Configurations, rotation_vector, skew
from jointstiff.solver.robot.model import Robot
from jointstiff.solver.triangle import whitened

_SHARE_OF_TRACE: Final = 0.5
"""Prior standard deviation of an entry relative to the elements' root mean square trace: on exact beams held
out, 95 % intervals of displacements then hold 97 % (20 and 40 postures) and 95 % (100) of the truth."""
_JOINT_PRIOR: Final = 10.0
"""Prior standard deviation of a joint's compliance, in units of what would explain all deflections."""
_LEAST_PRIOR: Final = 1e-6
"""Likewise of an entry at the least, where no element bends."""
_STEPS: Final = 20
_REACHED: Final = 1e-12
"""Distance [m] and angle [rad] from the wanted pose that is rounding."""
_DAMPING: Final = 1e-12
_PARTS: Final = 20
"""Parts of the postures that are left out in turn for the model error."""


@dataclass(frozen=True, eq=False)
class ElasticPredictor(ForwardModel):
    """Elastic joints and links, to first order in the load at the unloaded posture."""

    first_order = True

    columns: ElasticColumns  #: columns of the richest model
    kept: IndexArray  #: (p,) columns that the model has
    entries: FloatArray  #: (p,) compliances
    #: (p, p) upper triangular, root rootᵀ the covariance of the entries; None if it is unknown
    root: FloatArray | None
    seen: BoolArray  #: (n,) joints that the readings saw

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
            degrees_of_freedom=companion.degrees_of_freedom,
        )

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

    def deflect(
        self,
        cases: LoadCases,
        unloaded: Configurations | None = None,
        near: Configurations | None = None,  # noqa: ARG002  # nothing is balanced
    ) -> ElasticDeflection:
        """Bend links and joints at the unloaded posture."""
        return self._deflect(
            cases, self.unloaded(cases) if unloaded is None else unloaded, np.ones(len(cases))
        )

    def _deflect(self, cases: LoadCases, unloaded: Configurations, share: FloatArray) -> ElasticDeflection:
        """Take a share (B,) of the deflection."""
        places = self.places(cases, unloaded)
        moved = share[:, None] * places.deflection(self.compliances)
        still = unloaded.to_base(cases.place[:, None])[:, 0]
        return ElasticDeflection(
            model=self,
            cases=cases,
            moved=moved,
            place=still + moved[:, :3],
            axes=rotations(moved[:, 3:]) @ unloaded.flange_rotation,
            places=places,
        )

    def command(self, wanted: LoadCases, goal: Configurations, share: FloatArray) -> FloatArray:
        """Follow Newton's method to the posture whose bent place is the goal.

        The answer of the deflection to the posture is left out of the slope: each step gains three digits.

        Raises:
            RequestError: the place is at a singular posture, or too far.
        """
        target, q = goal.to_base(wanted.place[:, None])[:, 0], goal.q
        for _ in range(_STEPS):
            bent = self._deflect(wanted, Configurations(self.robot, q), share)
            turned = rotation_vector(goal.flange_rotation @ bent.axes.transpose(0, 2, 1))
            off = np.concatenate([target - bent.place, turned], axis=1)
            if (np.abs(off) <= _REACHED).all():
                return q
            jacobian = bent.places.jacobian
            normal = jacobian @ jacobian.transpose(0, 2, 1) + _DAMPING * np.eye(6)
            q = q + (jacobian.transpose(0, 2, 1) @ np.linalg.solve(normal, off[..., None]))[..., 0]
        raise RequestError(
            "no posture near this one brings the loaded tool to its place",
            where=f"cases[{int(np.argmax(np.abs(off).max(axis=1)))}]",
            remedy="move the part away from the singularity, or give no load here",
        )

    def linear_displacement(self, cases: LoadCases, unloaded: Configurations) -> FloatArray:
        """Return the displacements (B, 3) of the places [m]."""
        return self.places(cases, unloaded).deflection(self.compliances)[:, :3]

    def overloaded(self, cases: LoadCases, unloaded: Configurations) -> BoolArray:
        """Return whether the loads (B,) turn the flange beyond what is linear."""
        turned = self.places(cases, unloaded).deflection(self.compliances)[:, 3:]
        return np.asarray(np.linalg.norm(turned, axis=1) > LARGEST_TURN)


@dataclass(frozen=True, eq=False)
class ElasticDeflection(Deflection):
    """Deflections by elastic joints and links."""

    model: ElasticPredictor
    places: ElasticPlaces  #: kinematics and loads of the elements
    moved: FloatArray  #: (B, 6) displacement of the places [m], rotation vectors of the flange [rad]

    @property
    def displacement(self) -> FloatArray:
        """(B, 3) of the places [m]."""
        return self.moved[:, :3]

    @property
    def rotation(self) -> FloatArray:
        """(B, 3) rotation vectors of the flange [rad]."""
        return self.moved[:, 3:]

    @cached_property
    def rows(self) -> FloatArray:
        """(B, 6, p) by the entries that the model has: see `Deflection`."""
        return self.places.rows[..., self.model.kept]

    @cached_property
    def half(self) -> FloatArray | None:
        """(B, 6, p) H, H Hᵀ the covariance of displacement and rotation; None if it is unknown."""
        return None if self.model.root is None else np.asarray(self.rows @ self.model.root)

    @property
    def unseen(self) -> BoolArray:
        """(B, n) joints that the load twists and of which the readings say nothing."""
        twisted = np.abs(self.places.jacobian * self.places.torque[:, None]).max(axis=1) > 0.0
        return np.asarray(twisted & ~self.model.seen)

    @property
    def compliance(self) -> CartesianCompliance:
        """Cartesian compliance at the places, of unknown uncertainty."""
        nothing = np.zeros((len(self.cases), 6, self.model.robot.n))
        symmetric = np.ones(len(self.cases), dtype=np.bool_)
        return CartesianCompliance(
            self.places.compliance(self.model.compliances), symmetric, lambda: (nothing, nothing), None
        )

    def compliance_known(self, direction: FloatArray) -> tuple[BoolArray, BoolArray]:
        """Return whether the readings say something of all joints: see `Deflection`."""
        known = np.full(len(direction), self.model.seen.all())
        return known, known

    def interval(self, confidence: float) -> FloatArray | None:
        """Return intervals (B, 6, 2) of the normal distribution: see `Deflection`."""
        if self.half is None:
            return None
        value = np.concatenate([self.displacement, self.rotation], axis=1)
        spread = self.model.quantile(confidence) * np.linalg.norm(self.half, axis=-1)
        return np.asarray(value[..., None] + spread[..., None] * np.array([-1.0, 1.0]))

    def interval_along(self, direction: FloatArray, confidence: float) -> FloatArray:
        """Return intervals (B, 2) of the normal distribution: see `Deflection`."""
        value = np.einsum("bi,bi->b", direction, self.displacement)
        spread = self.model.quantile(confidence) * self.deviation_along(direction)
        return np.asarray(value[:, None] + spread[:, None] * np.array([-1.0, 1.0]))


def rotations(vectors: FloatArray) -> FloatArray:
    """Return the rotations (B, 3, 3) of rotation vectors (B, 3) [rad] (Rodrigues)."""
    turn = skew(vectors)
    angle = np.linalg.norm(vectors, axis=1)[:, None, None] / np.pi  # in half turns, as `sinc` takes it
    rotation: FloatArray = np.eye(3) + np.sinc(angle) * turn + 0.5 * np.sinc(0.5 * angle) ** 2 * (turn @ turn)
    return rotation


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


def folds_left_out(robot: Robot, measurements: Measurements, elastic: ElasticEstimate) -> ModelError:
    """Return the model error by the postures of `_PARTS` parts, each predicted by a fit to the others.

    So many leave hardly smaller sets to fit than the whole. Without the readings of a part, whitened rows A,
    the covariance ``C = L Lᵀ`` is ``L (I − Lᵀ AᵀA L)⁻¹ Lᵀ``.

    Raises:
        RequestError: nothing loads the robot.
        UnsupportedMethodError: there is one posture only.
    """
    model, sigma = ElasticPredictor.of(robot, elastic), elastic.companion.sigma
    plan = Plan(folds=_PARTS, draws=1, weights=(elastic.penalty,))
    folds = Folds(robot, measurements, elastic.model.columns, model.seen, plan)
    covariance = np.broadcast_to(measurements.covariance, (*measurements.present.shape, 3, 3))
    residuals, halves = [], []
    for number, indices in enumerate(folds.held_out):
        part, fit = measurements[indices], fit_fold(folds, elastic.model, number, plan.weights)
        residual, rows = elastic_residuals(robot, part, folds.columns, fit.compliances[0])
        half = np.zeros((len(rows), 3, 1))
        if model.root is not None and sigma is not None:
            half = rows[..., model.kept] @ model.root
            known = whitened(sigma**2 * covariance[indices][part.present], half).reshape(-1, half.shape[-1])
            factor = np.linalg.cholesky(np.eye(half.shape[-1]) - known.T @ known)
            half = half @ np.linalg.inv(factor).T
        residuals.append(residual)
        halves.append(half)
    return leave_folds_out(measurements, folds.held_out, residuals, halves)
