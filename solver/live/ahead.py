"""Planning of a live campaign: uncertainty relative to the goal, next reading, number of missing readings.

The readings so far determine how uncertain each compliance is; the rows of candidate readings determine by
how much another reading reduces the uncertainty. A goal is expressed as a weighted mean of variances, ``tr(W
M⁻¹)`` (A-optimality). The candidate that reduces the mean most is the next reading; the number of readings
that have to be chosen in this way until the goal is met is the number of missing readings.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final

import numpy as np

from jointstiff.schemas.plan import DecisionGoal, Goal, JointsGoal
from jointstiff.solver.arrays import BoolArray, FloatArray, IndexArray
from jointstiff.solver.design.candidates import (
    Equipment,
    PlanRequest,
    Pool,
    build_known_rows,
    build_reading_stack,
)
from jointstiff.solver.design.optimum import AOptimality, Atoms
from jointstiff.solver.design.plan import DistinctPostures
from jointstiff.solver.errors import RequestError
from jointstiff.solver.evidence.scatter import Posterior
from jointstiff.solver.live.forecast import FittedErrorColumns, Forecast
from jointstiff.solver.mechanics.measurements import NO_SCATTER, Measurements, Scatter
from jointstiff.solver.mechanics.robot import Robot

MOST_FOLLOWING: Final = 2
"""Greatest number of readings after the next one that are chosen ahead, as if each was read as predicted."""
MOST_MORE: Final = 60
"""Greatest number of missing readings that is computed: if more are missing, the goal is out of reach."""
_BEFORE: Final = 3.0
"""Relative standard uncertainty of a compliance before any reading, for the choice of the first readings."""
_TRIED: Final = 24
"""Number of candidates, those of the best prices, whose variance is computed exactly."""
_AS_GOOD: Final = 1.05
"""Factor on the least variance, up to which candidates count as equally good: the nearest posture is chosen
among them, because travel takes time."""
_TWISTS: Final = 1e-9
"""Deflection caused by a joint, relative to the greatest, below which the deflection counts as rounding."""
_FARTHER_OUT: Final = 0.3 * np.vstack([np.eye(3), -np.eye(3)[:2]])
"""Shifts (5, 3) of the hook that are tried, in the flange frame [m]; none leads back into the arm."""
_STRONGER: Final = 2.0
"""Factor on the force that is tried."""
_RATIO: Final = (0.2, 20.0)
"""Least and greatest allowed ratio of the uncertainty from readings to the uncertainty that the design
predicts."""


@dataclass(frozen=True, eq=False)
class KnownCompliances:
    """Compliances of n joints from the readings so far, with their covariance."""

    compliance: FloatArray  #: (n,) compliances [rad/(N·m)]; NaN for joints whose compliance is unknown
    #: (n, n) covariance [(rad/(N·m))²], including the model error if it is known; zero in the rows of joints
    #: whose compliance is unknown
    covariance: FloatArray
    factor: float  #: coverage factor of an interval of 95 %
    scatter: Scatter = NO_SCATTER  #: errors that the targets of a posture share, as the fit accounts for them
    posterior: Posterior | None = None  #: posterior of the scatter; None if the scatter is as stated

    @classmethod
    def before_any_reading(cls, n: int) -> KnownCompliances:
        """Return the compliances before any reading: NaN for each of the n joints."""
        return cls(np.full(n, np.nan), np.zeros((n, n)), 2.0)

    def expect_scatter(self, further: int) -> Scatter:
        """Return the scatter that a fit accounts for after a number of further readings.

        The more readings show no scatter, the less of an assumed one remains.
        """
        if self.posterior is None or not self.scatter.is_assumed:
            return self.scatter
        return self.posterior.expect(further).scatter

    @property
    def relative_uncertainty(self) -> FloatArray:
        """(n,) half-width of each compliance's interval divided by the compliance; inf if it is unknown."""
        half = self.factor * np.sqrt(np.diagonal(self.covariance))
        known = np.isfinite(self.compliance) & (np.nan_to_num(self.compliance) > 0.0)
        return np.where(known, half / np.where(known, self.compliance, 1.0), np.inf)


@dataclass(frozen=True, eq=False)
class UncertaintyShare:
    """Uncertainty so far, relative to the uncertainty that a goal allows."""

    #: uncertainty divided by the allowed uncertainty: (s,) for each joint that the loads twist, or (1,) for
    #: the deflection in the work area. The goal is met if no ratio exceeds 1; inf if the compliances are
    #: unknown
    ratios: FloatArray
    weights: FloatArray  #: (n, n) W in the weighted mean of variances tr(W M⁻¹) that readings have to reduce
    allowed: float  #: allowed uncertainty: relative, or of a deflection [m]
    joint: int | None = None  #: index of the joint that is farthest from the goal
    uncertainty: float | None = None  #: expanded uncertainty of the deflection in the work area [m]
    greatest: float | None = None  #: length of the greatest deflection in the work area [m]

    @property
    def greatest_share(self) -> float:
        """Greatest uncertainty relative to that of the goal; the goal is met at 1 or below."""
        return float(self.ratios.max())


@dataclass(frozen=True, eq=False)
class NextReading:
    """Posture and load of the next reading."""

    index: int  #: index of the candidate reading
    joints: FloatArray  #: (n,) joint angles as on the controller [rad]
    force: FloatArray  #: (3,) force in the axes of R0 [N]
    anchor: int | None  #: index of the anchor of the cable; None without a cable
    #: number of readings until the goal is met, including this reading; None for more than `MOST_MORE`
    missing: int | None
    #: readings that will probably follow, `MOST_FOLLOWING` at most; `missing` is None in them
    following: tuple[NextReading, ...] = ()


@dataclass(frozen=True, eq=False)
class CandidateReadings:
    """Candidate readings of a live campaign; they are drawn once, when the campaign begins."""

    robot: Robot
    request: PlanRequest
    pool: Pool
    #: (R, F, 3, n) deflections [m per rad/(N·m)] at R places of the work area under each of F forces, per
    #: unit of each joint's compliance
    work_area_deflections: FloatArray

    @classmethod
    def from_request(
        cls, robot: Robot, request: PlanRequest, force: FloatArray | None = None
    ) -> CandidateReadings:
        """Draw candidate readings, and compute the deflections at places of the work area.

        Args:
            robot: n joints.
            request: equipment and surroundings.
            force: (3,) process force in the work area, in the axes of R0 [N]; None for the force of the load.

        Raises:
            RequestError: no reading is feasible, or forces in the work area twist a joint that no load
                twists.
        """
        pool, loads, n = Pool.from_request(robot, request), request.equipment.loads, robot.n
        if pool.predicted is None:
            return cls(robot, request, pool, np.zeros((0, 1, 3, n)))
        # Deflections under a force along each of the three axes.
        under_axis_forces = pool.predicted[:, :, :n].reshape(-1, 3, 3, n)
        if force is None and loads.kind == "dead_weight":
            force = np.array([0.0, 0.0, -loads.force])
        deflections = (
            under_axis_forces
            if force is None
            else np.einsum("rfcn,f->rcn", under_axis_forces, force / loads.force)[:, None]
        )
        not_twisted = ~pool.parameters.basis[:n].any(axis=1)
        if (
            not_twisted.any()
            and np.abs(deflections[..., not_twisted]).max() > _TWISTS * np.abs(deflections).max()
        ):
            names = ", ".join(np.array(robot.joint_names)[not_twisted])
            raise RequestError(
                f"forces in the work area twist {names}, but the loads of the readings do not",
                where="open.load",
                remedy="apply forces in other directions, or give the goal a `force` that does not twist "
                "these joints",
            )
        return cls(robot, request, pool, deflections)

    @cached_property
    def with_other_loads(self) -> tuple[CandidateReadings, ...]:
        """Candidate readings with the hook 0.3 m farther out in each direction, and with twice the force.

        The goal remains that of these candidate readings. A load with which no reading is feasible is left
        out. The robot's own weight cannot be changed.
        """
        if self.request.own_weight_rows is not None:
            return ()
        equipment = self.request.equipment
        others = [replace(equipment, load_point=equipment.load_point + shift) for shift in _FARTHER_OUT]
        stronger = replace(equipment.loads, force=_STRONGER * equipment.loads.force)
        others.append(replace(equipment, loads=stronger))
        feasible = list[CandidateReadings]()
        for other in others:
            with suppress(RequestError):
                feasible.append(self._with_equipment(other))
        return tuple(feasible)

    def with_load_point(self, load_point: FloatArray) -> CandidateReadings:
        """Return the candidate readings with the hook at `load_point` (3,), flange frame [m].

        The goal remains that of these candidate readings.

        Raises:
            RequestError: no reading is feasible with this hook.
        """
        equipment = self.request.equipment
        if np.array_equal(equipment.load_point, load_point):
            return self
        return self._with_equipment(replace(equipment, load_point=load_point))

    def _with_equipment(self, equipment: Equipment) -> CandidateReadings:
        """Return the candidate readings with another load, and the same goal."""
        candidates = CandidateReadings.from_request(self.robot, replace(self.request, equipment=equipment))
        return replace(candidates, work_area_deflections=self.work_area_deflections)

    @property
    def twisted_joints(self) -> IndexArray:
        """(s,) indices of the joints that the loads twist."""
        return self.pool.parameters.joints

    def compare_with_goal(self, goal: Goal, known: KnownCompliances) -> UncertaintyShare:
        """Compare the uncertainty after the readings so far with the uncertainty that a goal allows.

        Args:
            goal: uncertainty of the joints, of the deflection in the work area, or for a decision whether the
                deflection exceeds a limit.
            known: compliances from the readings so far.
        """
        n = self.robot.n
        if isinstance(goal, JointsGoal):
            ratios = known.relative_uncertainty[self.twisted_joints] / goal.relative
            # The joints that are farthest from the goal count most.
            urgency = np.square(np.clip(np.where(np.isfinite(ratios), ratios, np.inf), 0.1, 10.0))
            weights = np.zeros((n, n))
            weights[self.twisted_joints, self.twisted_joints] = urgency / np.square(
                self._reference_compliances(known)[self.twisted_joints]
            )
            farthest = int(self.twisted_joints[np.argmax(ratios)])
            return UncertaintyShare(ratios, weights, goal.relative, joint=farthest)
        rows = self.work_area_deflections.reshape(-1, n)
        # The mean variance of the deflection is tr(mean_square · covariance).
        mean_square, unknown = rows.T @ rows / len(rows), ~np.isfinite(known.compliance)
        if unknown.any() and np.abs(rows[:, unknown]).max() > _TWISTS * np.abs(rows).max():
            allowed = goal.limit if isinstance(goal, DecisionGoal) else goal.uncertainty
            first_unknown = int(np.flatnonzero(unknown)[0])
            return UncertaintyShare(np.array([np.inf]), mean_square, allowed, joint=first_unknown)
        if not isinstance(goal, DecisionGoal):
            uncertainty = known.factor * float(np.sqrt((mean_square * known.covariance).sum()))
            ratios = np.array([uncertainty / goal.uncertainty])
            return UncertaintyShare(ratios, mean_square, goal.uncertainty, uncertainty=uncertainty)
        # A decision needs the deflection with the greatest upper end: it must be clearly below or above the
        # limit.
        deflections = self.work_area_deflections @ np.nan_to_num(known.compliance)
        length = np.linalg.norm(deflections, axis=-1)
        # Derivative of each deflection's length with respect to the compliances.
        along = np.einsum("...i,...ij->...j", deflections / length[..., None], self.work_area_deflections)
        u = known.factor * np.sqrt(np.einsum("...j,jk,...k->...", along, known.covariance, along))
        worst = np.unravel_index(int(np.argmax(length + u)), length.shape)
        uncertainty, greatest, row = float(u[worst]), float(length[worst]), along[worst]
        allowed = max(abs(goal.limit - greatest), 1e-12)
        ratios, weights = np.array([uncertainty / allowed]), np.outer(row, row)
        return UncertaintyShare(ratios, weights, allowed, uncertainty=uncertainty, greatest=greatest)

    def choose_next(
        self,
        goal: Goal,
        known: KnownCompliances,
        readings: Measurements | None,
        excluded: FloatArray,
        at: FloatArray | None = None,
    ) -> NextReading | None:
        """Choose the next reading: the candidate that reduces the uncertainty relative to the goal most.

        Args:
            goal: goal of the campaign.
            known: compliances from the readings so far.
            readings: the readings so far; None before the first reading.
            excluded: (K, n) postures that were already read or skipped, joint angles as on the controller
                [rad].
            at: (n,) present posture of the arm [rad]; None if travel does not matter.

        Returns:
            The reading, with the number of readings until the goal is met; None if no candidate remains.
        """
        parameters, candidates, share = (
            self.pool.parameters,
            self.pool.candidates,
            self.compare_with_goal(goal, known),
        )
        basis = parameters.basis[: self.robot.n]
        criterion = AOptimality(basis.T @ share.weights @ basis)
        M = self._compute_information(readings)  # the information of each reading is added
        # A weak prior keeps the information regular before enough postures are read.
        weak_prior = np.diag(np.full(len(M), _BEFORE**-2.0))
        distinct = DistinctPostures(self.pool.readings.joints, self.request.angle)
        free = np.ones(len(candidates), dtype=np.bool_)
        for posture in excluded:
            free &= np.abs(distinct.postures - posture).max(axis=1) >= self.request.angle
        if not free.any():
            return None
        best = self._choose_best_candidate(criterion, M + weak_prior, free, at)
        chosen, planned, missing = [self._make_reading(best)], list[Atoms](), None
        # The ratio of the uncertainties so far to the uncertainties that the design predicts is assumed to be
        # the same after further readings.
        forecast = self._forecast(known, readings, planned)
        predicted = self._predict_shares(goal, known, share, forecast)
        ratio = np.ones(len(predicted))
        comparable = np.isfinite(share.ratios) & np.isfinite(predicted)
        ratio[comparable] = np.clip(share.ratios[comparable] / predicted[comparable], *_RATIO)
        # Readings are added one after the other, until the predicted uncertainties meet the goal.
        for count in range(1, MOST_MORE + 1):
            M = M + best.information[0]
            free &= ~distinct.find_conflicts(int(best.index[0]))
            if missing is None:
                planned.append(best)
                forecast = self._forecast(known, readings, planned)
                shares = ratio * self._predict_shares(goal, known, share, forecast)
                missing = count if shares.max() <= 1.0 else None
            if not free.any() or (missing is not None and len(chosen) > MOST_FOLLOWING):
                break
            at = None if at is None else self.pool.readings.joints[int(best.index[0])]
            best = self._choose_best_candidate(criterion, M + weak_prior, free, at)
            if len(chosen) <= MOST_FOLLOWING:
                chosen.append(self._make_reading(best))
        return replace(chosen[0], missing=missing, following=tuple(chosen[1:]))

    def _make_reading(self, candidate: Atoms) -> NextReading:
        """Return the posture and the load of a candidate, given as `Atoms` of length one."""
        index = int(candidate.index[0])
        force = self.pool.candidate_forces(candidate.force, candidate.index)[0]
        anchor = int(self.pool.readings.anchor[index])
        return NextReading(
            index, self.pool.readings.joints[index], force, None if anchor < 0 else anchor, None
        )

    def _compute_information(self, readings: Measurements | None) -> FloatArray:
        """Compute the information (p, p) of the readings so far, with independent noise as of candidates."""
        if readings is None:
            return self.pool.base
        sigma = readings.sigma or self.request.equipment.sigma
        rows = build_known_rows(self.robot, self.request, readings) @ self.pool.parameters.basis / sigma
        return np.asarray(self.pool.base + rows.T @ rows)

    def _forecast(
        self, known: KnownCompliances, readings: Measurements | None, planned: Sequence[Atoms]
    ) -> Forecast:
        """Forecast the information of the readings so far and of planned readings.

        Each fit has errors that it estimates with the compliances, and the scatter of so many readings; none
        before the first reading, or under the robot's own weight.

        Args:
            known: compliances and scatter from the readings so far.
            readings: the readings so far; None before the first reading.
            planned: further readings, each as `Atoms` of length one.
        """
        if readings is None or self.request.own_weight_rows is not None:
            M = self._compute_information(readings) + sum(each.information[0] for each in planned)
            return Forecast.begin(np.asarray(M), np.zeros(0, dtype=np.bool_))
        scatter = known.expect_scatter(len(planned))
        basis, equipment = self.pool.parameters.basis, self.request.equipment
        sigma = readings.sigma or equipment.sigma
        errors = FittedErrorColumns.from_readings(self.robot, readings, known.compliance)
        scattered = replace(readings, scatter=scatter)
        rows = build_known_rows(self.robot, self.request, scattered) @ basis / sigma
        forecast = Forecast.begin(self.pool.base, errors.assumed).add(rows, errors.build(scattered, sigma))
        if not planned:
            return forecast
        further = self._build_planned(planned, scatter, sigma)
        rows = build_reading_stack(self.robot, self.request, further).flat[:, :-1] @ basis / equipment.sigma
        return forecast.add(rows, errors.build(further, equipment.sigma))

    def _build_planned(self, planned: Sequence[Atoms], scatter: Scatter, sigma: float) -> Measurements:
        """Build the measurements of planned readings with a scatter in units of the readings' sigma [m]."""
        equipment, readings = self.request.equipment, self.pool.readings
        index = np.concatenate([each.index for each in planned])
        force = np.concatenate([self.pool.candidate_forces(each.force, each.index) for each in planned])
        ratio = sigma / equipment.sigma
        of_equipment = Scatter(ratio * scatter.joints, ratio * scatter.station)
        along = None if readings.along is None else readings.along[index]
        return replace(equipment, scatter=of_equipment).build_measurements(
            self.robot, readings.joints[index], force, along
        )

    def _predict_shares(
        self, goal: Goal, known: KnownCompliances, share: UncertaintyShare, forecast: Forecast
    ) -> FloatArray:
        """Predict the ratios (s,) or (1,) of uncertainty to allowed uncertainty.

        Args:
            goal: goal of the campaign.
            known: compliances from the readings so far.
            share: uncertainty so far, relative to the goal.
            forecast: information of the readings so far and of predicted readings.
        """
        parameters = self.pool.parameters
        if isinstance(goal, JointsGoal):
            joints = self.twisted_joints
            half = known.factor * forecast.uncertainties(len(joints)) * parameters.nominal[joints]
            return np.asarray(half / self._reference_compliances(known)[joints] / goal.relative)
        basis = parameters.basis[: self.robot.n]
        deviation = forecast.weighted_variance(basis.T @ share.weights @ basis) ** 0.5
        return np.array([known.factor * deviation / share.allowed])

    def _reference_compliances(self, known: KnownCompliances) -> FloatArray:
        """Return the compliances (n,) [rad/(N·m)], where nominal values replace unknown compliances.

        With the nominal values all joints move the targets equally far.
        """
        return np.where(np.isfinite(known.compliance), known.compliance, self.pool.parameters.nominal)

    def _choose_best_candidate(
        self, criterion: AOptimality, M: FloatArray, free: BoolArray, at: FloatArray | None
    ) -> Atoms:
        """Return the free candidate that reduces the variance most; of nearly equal ones, the nearest.

        Args:
            criterion: weighted mean of variances that is to be reduced.
            M: (p, p) information so far.
            free: (N,) mask of the candidates that may be chosen.
            at: (n,) present posture of the arm [rad]; None if travel does not matter.

        Returns:
            The candidate as `Atoms` of length one: its index, force and information.
        """
        G = criterion.supergradient(M)
        prices = np.where(free, self.pool.candidates.prices(G), -np.inf)
        index = np.argsort(-prices)[: min(_TRIED, int(free.sum()))]
        tried = self.pool.candidates.build_atoms(index, G)
        variance = 1.0 / criterion.information(M + tried.information)
        good = np.flatnonzero(variance <= _AS_GOOD * variance.min())
        joints = self.pool.readings.joints[index[good]]
        # Without a present posture, the least variance decides.
        cost = variance[good] if at is None else np.abs(joints - at).max(axis=1)
        best = good[np.argmin(cost)]
        return tried[best : best + 1]
