"""Progress of a campaign: its share of the goal, the next reading, and the number of those that are missing.

The readings at hand say how uncertain each compliance is; rows of candidate readings say by how much one
more reduces that. A goal becomes a weighted mean of variances, ``tr(W M⁻¹)`` (A-optimality): the candidate
that lessens it most is next, and the number of those that follow until the goal is met is what is missing.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from jointstiff.schemas.plan import DecisionGoal, Goal, JointsGoal
from jointstiff.solver.arrays import BoolArray, FloatArray, IndexArray
from jointstiff.solver.design.candidates import PlanRequest, Pool, build_known_rows
from jointstiff.solver.design.optimum import AOptimality, Atoms, compute_uncertainties
from jointstiff.solver.design.plan import DistinctPostures
from jointstiff.solver.errors import RequestError
from jointstiff.solver.mechanics.measurements import Measurements
from jointstiff.solver.mechanics.robot import Robot

MOST_MORE: Final = 60
"""Readings that are looked ahead: where more are missing, the goal is not within reach."""
_BEFORE: Final = 3.0
"""Relative standard uncertainty of a compliance before any reading, for the choice of the first ones."""
_TRIED: Final = 24
"""Candidates of the best prices whose reading is evaluated exactly."""
_AS_GOOD: Final = 1.05
"""Factor within which the nearest of the candidates is taken: travel takes time."""
_TWISTS: Final = 1e-9
"""Deflection by a joint, relative to the greatest, below which it counts as rounding."""
_RATIO: Final = (0.2, 20.0)
"""Least and greatest factor between what the readings say and what the design expects."""


@dataclass(frozen=True, eq=False)
class KnownCompliances:
    """Compliances of n joints by the readings so far."""

    compliance: FloatArray  #: (n,) [rad/(N·m)]; NaN of joints without a number
    covariance: FloatArray  #: (n, n) with the model error, as far as it is known; rows of others are zero
    factor: float  #: coverage factor of an interval of 95 %

    @classmethod
    def before_any_reading(cls, n: int) -> KnownCompliances:
        """Return the compliances before any reading: NaN for each of the n joints."""
        return cls(np.full(n, np.nan), np.zeros((n, n)), 2.0)

    @property
    def relative(self) -> FloatArray:
        """(n,) half-width of each compliance's interval over the compliance; inf where it is unknown."""
        half = self.factor * np.sqrt(np.diagonal(self.covariance))
        known = np.isfinite(self.compliance) & (np.nan_to_num(self.compliance) > 0.0)
        return np.where(known, half / np.where(known, self.compliance, 1.0), np.inf)


@dataclass(frozen=True, eq=False)
class UncertaintyShare:
    """Uncertainty so far, relative to that of a goal."""

    #: (s,) of the joints that loads twist, or (1,): uncertainty over that of the goal, which is met where all
    #: are 1 at most; inf where nothing is known
    each: FloatArray
    weights: FloatArray  #: (n, n) W of compliances whose variances are to become less
    allowed: float  #: what the uncertainty may be: relative, or of a deflection [m]
    joint: int | None = None  #: joint that is farthest from the goal
    uncertainty: float | None = None  #: expanded, of the deflection in the work area [m]
    greatest: float | None = None  #: length of the greatest deflection there [m]

    @property
    def greatest_share(self) -> float:
        """Greatest uncertainty relative to that of the goal; the goal is met at 1 or below."""
        return float(self.each.max())


@dataclass(frozen=True, eq=False)
class NextReading:
    """The next reading."""

    index: int  #: index of the candidate
    joints: FloatArray  #: (n,) controller's angles [rad]
    force: FloatArray  #: (3,) axes of R0 [N]
    anchor: int | None  #: index of the anchor of the cable; None without a cable
    missing: (
        int | None
    )  #: readings until the goal is met, this one among them; None for more than `MOST_MORE`


@dataclass(frozen=True, eq=False)
class CandidateReadings:
    """Candidate readings of a live campaign; they are drawn once, when the campaign begins."""

    robot: Robot
    request: PlanRequest
    pool: Pool
    places: (
        FloatArray  #: (R, F, 3, n) deflections [m] at places of the work area, by each of the forces there
    )

    @classmethod
    def from_request(
        cls, robot: Robot, request: PlanRequest, force: FloatArray | None = None
    ) -> CandidateReadings:
        """Draw candidate readings, and compute the deflections at places of the work area.

        Args:
            robot: n joints.
            request: equipment and surroundings.
            force: (3,) process force in the work area, axes of R0 [N]; None for the force of the load.

        Raises:
            RequestError: no reading is feasible, or forces in the work area twist a joint that no load
                twists.
        """
        pool, loads, n = Pool.from_request(robot, request), request.equipment.loads, robot.n
        if pool.predicted is None:
            return cls(robot, request, pool, np.zeros((0, 1, 3, n)))
        by_axis = pool.predicted[:, :, :n].reshape(-1, 3, 3, n)
        if force is None and loads.kind == "dead_weight":
            force = np.array([0.0, 0.0, -loads.force])
        places = by_axis if force is None else np.einsum("rfcn,f->rcn", by_axis, force / loads.force)[:, None]
        hidden = ~pool.parameters.basis[:n].any(axis=1)
        if hidden.any() and np.abs(places[..., hidden]).max() > _TWISTS * np.abs(places).max():
            names = ", ".join(np.array(robot.joint_names)[hidden])
            raise RequestError(
                f"the loads do not twist {names}, but forces in the work area do",
                where="open.load",
                remedy="apply forces in other directions, or give the goal a `force` that does not twist it",
            )
        return cls(robot, request, pool, places)

    @property
    def wanted(self) -> IndexArray:
        """(s,) indices of the joints that the loads twist."""
        return self.pool.parameters.joints

    def compare_with_goal(self, goal: Goal, known: KnownCompliances) -> UncertaintyShare:
        """Compare the uncertainty after the readings so far with the uncertainty that a goal allows.

        Args:
            goal: for joints, for a deflection in the work area, or for a decision about a limit.
            known: compliances by the readings so far.
        """
        n = self.robot.n
        if isinstance(goal, JointsGoal):
            each = known.relative[self.wanted] / goal.relative
            # The joints that are farthest from the goal count most.
            urgent = np.square(np.clip(np.where(np.isfinite(each), each, np.inf), 0.1, 10.0))
            weights = np.zeros((n, n))
            weights[self.wanted, self.wanted] = urgent / np.square(
                self._reference_compliances(known)[self.wanted]
            )
            return UncertaintyShare(each, weights, goal.relative, joint=int(self.wanted[np.argmax(each)]))
        rows = self.places.reshape(-1, n)
        mean, hidden = rows.T @ rows / len(rows), ~np.isfinite(known.compliance)
        if hidden.any() and np.abs(rows[:, hidden]).max() > _TWISTS * np.abs(rows).max():
            allowed = goal.limit if isinstance(goal, DecisionGoal) else goal.uncertainty
            return UncertaintyShare(np.array([np.inf]), mean, allowed, joint=int(np.flatnonzero(hidden)[0]))
        if not isinstance(goal, DecisionGoal):
            uncertainty = known.factor * float(np.sqrt((mean * known.covariance).sum()))
            each = np.array([uncertainty / goal.uncertainty])
            return UncertaintyShare(each, mean, goal.uncertainty, uncertainty=uncertainty)
        deflections = self.places @ np.nan_to_num(known.compliance)
        length = np.linalg.norm(deflections, axis=-1)
        along = np.einsum("...i,...ij->...j", deflections / length[..., None], self.places)
        u = known.factor * np.sqrt(np.einsum("...j,jk,...k->...", along, known.covariance, along))
        worst = np.unravel_index(int(np.argmax(length + u)), length.shape)
        uncertainty, greatest, row = float(u[worst]), float(length[worst]), along[worst]
        allowed = max(abs(goal.limit - greatest), 1e-12)
        each = np.array([uncertainty / allowed])
        return UncertaintyShare(each, np.outer(row, row), allowed, uncertainty=uncertainty, greatest=greatest)

    def choose_next(
        self,
        goal: Goal,
        known: KnownCompliances,
        readings: Measurements | None,
        taken: FloatArray,
        at: FloatArray | None = None,
    ) -> NextReading | None:
        """Choose the next reading: the candidate that reduces the uncertainty relative to the goal most.

        Args:
            goal: goal of the campaign.
            known: compliances by the readings so far.
            readings: the readings so far.
            taken: (K, n) postures that were read or skipped, controller's angles [rad].
            at: (n,) present posture of the arm; None where travel does not matter.

        Returns:
            The reading, with the number of readings until the goal is met; None if no candidate is left.
        """
        parameters, candidates, share = (
            self.pool.parameters,
            self.pool.candidates,
            self.compare_with_goal(goal, known),
        )
        basis = parameters.basis[: self.robot.n]
        criterion = AOptimality(basis.T @ share.weights @ basis)
        M = self.pool.base
        if readings is not None:
            rows = build_known_rows(self.robot, self.request, readings) @ parameters.basis
            M = M + rows.T @ rows / (readings.sigma or self.request.equipment.sigma) ** 2
        vague = np.diag(np.full(len(M), _BEFORE**-2.0))
        distinct = DistinctPostures(self.pool.readings.joints, self.request.angle)
        free = np.ones(len(candidates), dtype=np.bool_)
        for posture in taken:
            free &= np.abs(distinct.postures - posture).max(axis=1) >= self.request.angle
        if not free.any():
            return None
        best = self._best_candidate(criterion, M + vague, free, at)
        first, missing = int(best.index[0]), None
        # The factor between uncertainties so far and the design's is taken to hold for further readings.
        expected = self._predict_shares(goal, known, share, M)
        ratio = np.ones(len(expected))
        certain = np.isfinite(share.each) & np.isfinite(expected)
        ratio[certain] = np.clip(share.each[certain] / expected[certain], *_RATIO)
        force, anchor = (
            self.pool.candidate_forces(best.force, best.index)[0],
            int(self.pool.readings.anchor[first]),
        )
        for count in range(1, MOST_MORE + 1):
            M = M + best.information[0]
            free &= ~distinct.find_conflicts(int(best.index[0]))
            if (ratio * self._predict_shares(goal, known, share, M)).max() <= 1.0:
                missing = count
                break
            if not free.any():
                break
            best = candidates.find_highest_priced(criterion.support(M + vague), free)
        joints = self.pool.readings.joints[first]
        return NextReading(first, joints, force, None if anchor < 0 else anchor, missing)

    def _predict_shares(
        self, goal: Goal, known: KnownCompliances, share: UncertaintyShare, M: FloatArray
    ) -> FloatArray:
        """Predict the uncertainties relative to the goal's, (s,) or (1,), after readings of information M."""
        parameters = self.pool.parameters
        if isinstance(goal, JointsGoal):
            half = known.factor * compute_uncertainties(M, len(self.wanted)) * parameters.nominal[self.wanted]
            return np.asarray(half / self._reference_compliances(known)[self.wanted] / goal.relative)
        basis = parameters.basis[: self.robot.n]
        information = AOptimality(basis.T @ share.weights @ basis).information(M)
        deviation = information**-0.5 if information > 0.0 else np.inf
        return np.array([known.factor * deviation / share.allowed])

    def _reference_compliances(self, known: KnownCompliances) -> FloatArray:
        """Return the compliances (n,); unknown ones such that all joints move the targets equally far."""
        return np.where(np.isfinite(known.compliance), known.compliance, self.pool.parameters.nominal)

    def _best_candidate(
        self, criterion: AOptimality, M: FloatArray, free: BoolArray, at: FloatArray | None
    ) -> Atoms:
        """Return the free candidate that reduces the variance most; among nearly equal ones, the nearest.

        Args:
            criterion: variance to be reduced.
            M: (p, p) information so far.
            free: (N,) candidates that may be chosen.
            at: (n,) present posture of the arm; None where travel does not matter.
        """
        G = criterion.support(M)
        prices = np.where(free, self.pool.candidates.prices(G), -np.inf)
        index = np.argsort(-prices)[: min(_TRIED, int(free.sum()))]
        tried = self.pool.candidates.build_atoms(index, G)
        left = 1.0 / criterion.information(M + tried.information)
        good = np.flatnonzero(left <= _AS_GOOD * left.min())
        far = left[good] if at is None else np.abs(self.pool.readings.joints[index[good]] - at).max(axis=1)
        best = good[np.argmin(far)]
        return tried[best : best + 1]
