"""Elastic joints as a forward model: compliances, what is known of their errors, and the exact balance."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np

from jointstiff.solver.arrays import BoolArray, FloatArray, IndexArray
from jointstiff.solver.convex.problem import Constraints
from jointstiff.solver.deflection.cartesian import CartesianCompliance
from jointstiff.solver.deflection.forward import LARGEST_TURN, Deflection, ForwardModel
from jointstiff.solver.deflection.load_cases import LoadCases
from jointstiff.solver.deflection.own_weight import IdentifiedWeight, OwnWeight
from jointstiff.solver.errors import SolverError
from jointstiff.solver.fitting.fit import Likelihood
from jointstiff.solver.inference.estimate import Estimate
from jointstiff.solver.inference.profile import profile_row_ends, range_on_box
from jointstiff.solver.observability import Spectrum
from jointstiff.solver.robot.configuration import Configurations, rotation_vector, skew
from jointstiff.solver.robot.model import Robot
from jointstiff.solver.terms.balance import Balance, balance, wrench_stiffness

_UNSEEN: Final = 1e-9
"""Share of a row in what the readings do not determine, below which it is rounding."""
_BLOCK: Final = 500
"""Rows whose ends are found together: each takes some matrices of n × n numbers."""
_LEAST_SIGMA: Final = 1e-15
"""Rounding of a position [m]: no reading is better."""
_WEIGHT_STEPS: Final = 8
"""Steps in which the own weight of the commanded posture settles; each gains three digits."""
_TILT: Final = 5e-3
"""Torque of own weight, relative to another joint's, that a vertical axis has if not quite vertical."""
_SOFTEST: Final = 0.5
"""Share of the joints' stiffness that the load may take away; more is no load of a process."""


@dataclass(frozen=True, eq=False)
class JointModel(ForwardModel):
    """Elastic joints: the exact balance of springs, load and own weight."""

    first_order = False

    compliance: FloatArray  #: (n,) [rad/(N·m)]; zero where nothing is known
    #: of the compliances that were seen, before any constraint, in SI units; None where no uncertainty is
    #: known
    likelihood: Likelihood | None
    constraints: Constraints  #: on all n compliances
    #: of the links; None leaves it out, as the controller's zero has it in already; an identified one's sag
    #: is part of the deflections
    weight: OwnWeight | None = None

    @classmethod
    def of(cls, robot: Robot, estimate: Estimate, constraints: Constraints) -> JointModel:
        """Take over what an identification found."""
        likelihood = estimate.likelihood if estimate.covariance is not None else None
        if likelihood is not None:
            sigma = max(float(estimate.sigma or 0.0), _LEAST_SIGMA)
            rows = None if likelihood.given_rows is None else likelihood.given_rows / sigma
            likelihood = Likelihood(
                likelihood.joints, likelihood.centre, sigma**2 * likelihood.covariance, rows
            )
        freedom = None if estimate.sigma_given else estimate.degrees_of_freedom
        return cls(robot, estimate.compliance, likelihood, constraints, degrees_of_freedom=freedom)

    @cached_property
    def covariance(self) -> FloatArray:
        """(n, n) of the unconstrained estimate [(rad/(N·m))²]; zero for joints that were not seen."""
        covariance = np.zeros((self.robot.n, self.robot.n))
        if self.likelihood is not None:
            covariance[np.ix_(self.likelihood.joints, self.likelihood.joints)] = self.likelihood.covariance
        return covariance

    @cached_property
    def root(self) -> FloatArray:
        """(n, n) matrix whose product with its transpose is the covariance."""
        values, vectors = np.linalg.eigh(self.covariance)
        return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0)))

    def deflect(
        self, cases: LoadCases, unloaded: Configurations | None = None, near: Configurations | None = None
    ) -> JointDeflection:
        """Balance springs and loads.

        Raises:
            RequestError: a load finds no stable balance near the unloaded posture.
        """
        unloaded = self.unloaded(cases) if unloaded is None else unloaded
        equilibrium = balance(self.robot, self.compliance, cases, self.weight, unloaded, near or unloaded)
        loaded, place = equilibrium.loaded, cases.place[:, None]
        reached = loaded.to_base(place)
        jacobian = np.concatenate([loaded.jacobian_at(reached)[:, 0], loaded.angular_jacobian], axis=1)
        moved = (jacobian @ equilibrium.step[..., None])[..., 0]
        axes = loaded.flange_rotation + skew(moved[:, 3:]) @ loaded.flange_rotation
        return JointDeflection(
            model=self,
            cases=cases,
            unloaded=unloaded,
            moved=moved,
            place=reached[:, 0] + moved[:, :3],
            axes=axes,
            balance=equilibrium,
            jacobian=jacobian,
        )

    def command(self, wanted: LoadCases, goal: Configurations, share: FloatArray) -> FloatArray:
        """Return ``θ − s c ∘ (τ(θ) + g(θ) − g(q_cmd))`` (B, n), angles of the model [rad]."""
        step = share[:, None] * self.compliance
        torque = goal.load(wanted.load_point, wanted.force, wanted.moment)[1]
        commanded: FloatArray = goal.q - step * torque
        if self.weight is None:
            return commanded
        weight_torque = self.weight.torque_and_stiffness(self.robot, goal)[0]
        if self.weight.absolute:
            return commanded - step * weight_torque
        for _ in range(_WEIGHT_STEPS):
            rest = self.weight.torque_and_stiffness(self.robot, Configurations(self.robot, commanded))[0]
            commanded = goal.q - step * (torque + weight_torque - rest)
        return commanded

    def linear_displacement(self, cases: LoadCases, unloaded: Configurations) -> FloatArray:
        """Return ``J diag(c) τ`` (B, 3) [m]."""
        torque = unloaded.load(cases.load_point, cases.force, cases.moment)[1]
        if self.weight is not None and self.weight.absolute:
            torque = torque + self.weight.torque_and_stiffness(self.robot, unloaded)[0]
        turned = self.compliance * torque
        jacobian = unloaded.jacobian_at(unloaded.to_base(cases.place[:, None]))[:, 0]
        return np.asarray((jacobian @ turned[..., None])[..., 0])

    def overloaded(self, cases: LoadCases, unloaded: Configurations) -> BoolArray:
        """Return whether the loads (B,) turn a joint, or soften it, beyond what springs describe."""
        jacobian, torque = unloaded.load(cases.load_point, cases.force, cases.moment)
        turned = np.asarray((np.abs(self.compliance * torque) > LARGEST_TURN).any(axis=1))
        force, moment = (np.linalg.norm(part, axis=1) for part in (cases.force, cases.moment))
        lever = np.sqrt(np.square(jacobian).sum(axis=1).max(axis=1))
        # No entry of K_c is greater than |F| |v| + |M|: far below the limit, there is no need of entries.
        some = np.flatnonzero(
            ~turned & (self.compliance.max() * self.robot.n * (force * lever + moment) > _SOFTEST)
        )
        axes, loads = unloaded.angular_jacobian[some], (cases.force[some], cases.moment[some])
        softening = self.compliance * np.abs(wrench_stiffness(axes, jacobian[some], *loads)).sum(axis=2)
        turned[some] = (softening > _SOFTEST).any(axis=1)
        return turned

    @cached_property
    def _unseen_directions(self) -> FloatArray:
        """(u, n) directions of the compliances that the readings do not determine, in scaled compliances."""
        joints = np.arange(self.robot.n) if self.likelihood is None else self.likelihood.joints
        hidden = np.eye(self.robot.n)[np.setdiff1d(np.arange(self.robot.n), joints)]
        if self.likelihood is None or self.likelihood.given_rows is None:
            return hidden
        null = np.zeros((0, self.robot.n))
        spectrum = Spectrum(self.likelihood.given_rows)
        if len(spectrum.null_space):
            null = np.zeros((len(spectrum.null_space), self.robot.n))
            null[:, joints] = spectrum.null_space / spectrum.scale * spectrum.scale.max()
        return np.concatenate([hidden, null])

    def unseen(self, rows: FloatArray) -> BoolArray:
        """(B, n) joints whose unknown compliance has a part in linear functions (B, w, n) of all."""
        if not len(self._unseen_directions):
            return np.zeros((len(rows), self.robot.n), dtype=np.bool_)
        size = np.abs(rows).max(axis=(1, 2), initial=0.0)[:, None, None]
        parts = rows @ self._unseen_directions.T  # (B, w, u)
        counts = (np.abs(parts) > _UNSEEN * size).any(axis=1)  # (B, u)
        joints = (counts[:, :, None] & (np.abs(self._unseen_directions) > _UNSEEN)).any(axis=1)
        return np.asarray(joints)

    def ends(self, rows: FloatArray, confidence: float) -> FloatArray | None:
        """Return the ends of intervals of linear functions aᵀc under the constraints (method.md §9).

        As for joints, the profile's ends are widened to contain what the constraints leave of the
        unconstrained interval, and the estimate.

        Args:
            rows: (K, n) functions a.
            confidence: level.

        Returns:
            (K, 2) in the unit of aᵀc; None where no uncertainty is known.
        """
        ends = self.free_ends(rows, confidence)
        if ends is None or self.likelihood is None:
            return None
        constraints, part = self.constraints.select(self.likelihood.joints), rows[:, self.likelihood.joints]
        some = np.flatnonzero(self._variance(part) > 0.0)
        if not constraints.order:  # with an order the box is no longer the range: the free ends are wider
            for start in range(0, len(some), _BLOCK):
                block = some[start : start + _BLOCK]
                with suppress(SolverError):  # the free ends cover by themselves, wherever the truth lies
                    profile = profile_row_ends(
                        self.likelihood, constraints, part[block], np.array([self.quantile(confidence)])
                    )[0]
                    ends[block, 0] = np.minimum(ends[block, 0], profile[:, 0])
                    ends[block, 1] = np.maximum(ends[block, 1], profile[:, 1])
        return ends

    def free_ends(self, rows: FloatArray, confidence: float) -> FloatArray | None:
        """Return what the bounds leave of the unconstrained intervals of aᵀc, widened to hold the estimate.

        They cover by themselves, without a program to solve for each.

        Args:
            rows: (K, n) functions a.
            confidence: level.

        Returns:
            (K, 2) in the unit of aᵀc; None where no uncertainty is known.
        """
        if self.likelihood is None:
            return None
        joints: IndexArray = self.likelihood.joints
        value = rows @ self.compliance
        ends = np.stack([value, value], axis=-1)
        part, bounds = rows[:, joints], self.constraints.select(joints).bounds
        half = self.quantile(confidence) * np.sqrt(self._variance(part))[:, None] * np.array([-1.0, 1.0])
        some = half[:, 1] > 0.0
        box = range_on_box(part[some], bounds)
        held = np.clip((part[some] @ self.likelihood.centre)[:, None] + half[some], box[:, :1], box[:, 1:])
        ends[some, 0] = np.minimum(held[:, 0], value[some])
        ends[some, 1] = np.maximum(held[:, 1], value[some])
        return ends

    def _variance(self, part: FloatArray) -> FloatArray:
        """(K,) of functions (K, p) of the compliances that were seen, without constraints."""
        if self.likelihood is None:
            return np.zeros(len(part))
        variance: FloatArray = ((part @ self.likelihood.covariance) * part).sum(axis=1)
        return variance


@dataclass(frozen=True, eq=False)
class JointDeflection(Deflection):
    """Deflections by elastic joints; rows and compliance are of the loaded posture."""

    model: JointModel
    unloaded: Configurations  #: kinematics without the load
    moved: FloatArray  #: (B, 6) what the last step of the balance adds to places and axes [m, rad]
    balance: Balance  #: balance of springs and loads
    jacobian: FloatArray  #: (B, 6, n) jacobian of the places [m/rad, then rad/rad], in the loaded posture

    @cached_property
    def displacement(self) -> FloatArray:
        """(B, 3) of the places [m]."""
        there, here = (at.to_base(self.cases.place[:, None]) for at in (self.balance.loaded, self.unloaded))
        return np.asarray((there - here)[:, 0] + self.moved[:, :3])

    @cached_property
    def rotation(self) -> FloatArray:
        """(B, 3) rotation vectors of the flange [rad]."""
        return rotation_vector(self.axes @ self.unloaded.flange_rotation.transpose(0, 2, 1))

    @cached_property
    def softened(self) -> FloatArray:
        """(B, n, n) ``(I − diag(c)(K_c + ∂g/∂q))⁻¹``, the answer of δθ to a change of c ∘ τ."""
        return np.asarray(np.linalg.inv(self.balance.slope))

    @cached_property
    def _answer(self) -> FloatArray:
        return self.jacobian @ self.softened

    @cached_property
    def rows(self) -> FloatArray:
        """(B, 6, n) ``J_x (I − diag(c)(K_c + ∂g/∂q))⁻¹ diag(τ)``, τ of loads only beside a sag."""
        return np.asarray(self._answer * self._torque[:, None])

    @cached_property
    def _torque(self) -> FloatArray:
        if self.model.weight is None or not self.model.weight.absolute:
            return self.balance.torque
        return self.balance.loaded.load(self.cases.load_point, self.cases.force, self.cases.moment)[1]

    @cached_property
    def half(self) -> FloatArray | None:
        """(B, 6, r) H, H Hᵀ the covariance of displacement and rotation; None if it is unknown."""
        if isinstance(self.model.weight, IdentifiedWeight):
            turn = self.model.weight.turn_root(self.model.robot, self.balance.loaded, self._torque)
            return np.asarray(self._answer @ turn)
        return None if self.model.likelihood is None else np.asarray(self.rows @ self.model.root)

    @property
    def unseen(self) -> BoolArray:
        """(B, n) joints that load, or weight of a sag, twists and of which the readings say nothing."""
        unseen, weight = self.model.unseen(self.rows), self.model.weight
        if isinstance(weight, IdentifiedWeight):
            own = np.abs(self.balance.torque - self._torque)
            unseen |= ~weight.determined & (own > _TILT * own.max(axis=1, keepdims=True))
        return unseen

    @property
    def compliance(self) -> CartesianCompliance:
        """Cartesian compliance at the places, in the loaded postures."""
        return CartesianCompliance(
            matrix=(self._answer * self.model.compliance) @ self.jacobian.transpose(0, 2, 1),
            symmetric=(self.cases.moment == 0.0).all(axis=1),
            by_joint=self._compliance_by_joint,
            covariance=None if self.model.likelihood is None else self.model.covariance,
        )

    def _compliance_by_joint(self) -> tuple[FloatArray, FloatArray]:
        # (I − K diag(c))⁻¹ = I + K (I − diag(c) K)⁻¹ diag(c)
        more = self.balance.stiffness @ (self.softened * self.model.compliance)
        stiffened = np.eye(self.model.robot.n) + more
        return self._answer, self.jacobian @ stiffened.transpose(0, 2, 1)

    def compliance_known(self, direction: FloatArray) -> tuple[BoolArray, BoolArray]:
        """Return whether the readings determine the joints that answer: see `Deflection`."""
        linear = self.jacobian[:, :3]
        along = np.square(np.einsum("bi,bij->bj", direction, linear))
        across = np.maximum(np.einsum("bij,bij->bj", linear, linear) - along, 0.0)
        unknown_along, unknown_across = (
            self.model.unseen(rows[:, None]).any(axis=1) for rows in (along, across)
        )
        return np.asarray(~unknown_along), np.asarray(~unknown_across)

    def interval(self, confidence: float) -> FloatArray | None:
        """Return intervals (B, 6, 2) under the constraints: see `Deflection`."""
        value = np.concatenate([self.displacement, self.rotation], axis=1)
        if isinstance(self.model.weight, IdentifiedWeight):
            half = np.linalg.norm(self.half, axis=2)[..., None]  # type: ignore[arg-type]
            return np.asarray(value[..., None] + self.model.quantile(confidence) * half * [-1.0, 1.0])
        ends = self.model.ends(self.rows.reshape(-1, self.model.robot.n), confidence)
        if ends is None:
            return None  # aᵀc is linear, the balance is not: shift the ends to where the value is
        return np.asarray(
            ends.reshape(*value.shape, 2) + (value - self.rows @ self.model.compliance)[..., None]
        )

    def interval_along(self, direction: FloatArray, confidence: float) -> FloatArray:
        """Return what the bounds leave of intervals (B, 2): see `Deflection`."""
        value = np.einsum("bi,bi->b", direction, self.displacement)
        if isinstance(self.model.weight, IdentifiedWeight):
            half = self.model.quantile(confidence) * self.deviation_along(direction)
            return np.stack([value - half, value + half], axis=1)
        rows = np.einsum("bi,bij->bj", direction, self.rows[:, :3])
        free = self.model.free_ends(rows, confidence)
        if free is None:
            return np.full((len(direction), 2), np.nan)
        return np.asarray(free + (value - rows @ self.model.compliance)[:, None])
