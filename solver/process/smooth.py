"""Turns along a path as a smooth function of its length: cubic splines, by a sequence of convex programs.

Each program states the squared deflection at places along the path as parabolas of the turn, and the limits
of speeds, positions and singularity as linear functions of turn and rate (method.md §16). On a line between
two points the controller turns the tool evenly, so that the turn there is the straight line between those of
the points.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Final

import numpy as np
from scipy.interpolate import BSpline
from scipy.sparse import block_diag, csr_array, diags_array, vstack

from jointstiff.solver.arrays import BoolArray, FloatArray, IndexArray
from jointstiff.solver.mechanics.inverse import InverseKinematics
from jointstiff.solver.mechanics.postures import Postures, rotation_vectors
from jointstiff.solver.predict.forward import ForwardModel
from jointstiff.solver.process.candidates import CLEARANCE_ROOM, ROOM
from jointstiff.solver.process.path import ProcessPath

if TYPE_CHECKING:
    from jointstiff.solver.fit.programs import TurnProgram

_PLACES: Final = 0.01
"""Greatest distance of the places at which a program holds the limits [m]."""
_PLACES_A_KNOT: Final = 2.0
"""Least number of these places for each of the spline's knots: between fewer ones the rate has peaks."""
_SPREAD: Final = 1.2
"""Distance of the spline's knots, relative to that of the knots of the choice."""
_ROUNDS, _ROUNDS_AGAIN = 5, 3
"""Programs, each about the turn of the one before: of a first turn, and of one whose limits were lowered."""
_ROUNDS_TO_COMPARE: Final = 2
"""Programs after which two routes are compared: the better one then needs `_ROUNDS_AGAIN` more."""
_STEP: Final = float(np.radians(2.0))
"""Turn by which a parabola is stated [rad]."""
_TRUST: Final = float(np.radians(15.0))
_TRUST_AGAIN: Final = float(np.radians(3.0))
_MOST_TRUST: Final = float(np.radians(120.0))
"""Turn from the one before that a program may choose [rad]: of the first one, the least, and the greatest."""
_FARTHEST: Final = 1.2
"""Motion of a joint in a round [rad] beyond which the round is repeated with less trust."""
_SETTLED: Final = float(np.radians(0.1))
"""Greatest change of a turn after which no further round is needed [rad]."""
_NEARER: Final = 0.3
"""Part of the trust within which a motion that exceeds a limit has to come nearer to this limit."""
_LEAST_CURVATURE: Final = 0.05
_AT_END: Final = 1e-6
"""Distance of a turn from the end of its range that is the tolerance of a program [rad]."""
_NEAR: Final = 4.0
"""Singular values within this factor of the clearance are limited."""


ROUGHNESS: Final = (1e-7, 1e-6, 1e-5)
"""Costs of the mean square of d²φ/ds², relative to the mean square of the deflections [m⁴/rad²].

They are tried in this order, until a turn keeps all limits."""
_PART: Final = 0.95
"""Part of the limits of speed and rate that a program may use at first."""
_AGAIN: Final = 0.95
"""Need that a program aims at where a turn exceeded a limit, relative to this limit."""


@dataclass(frozen=True, eq=False)
class Parts:
    """Parts of the limits that a program may use, on the line to each of m points.

    A program holds the limits to first order, at places along the path: where the turn exceeds them between
    these places or to second order, the next program uses less of them there.
    """

    speed: FloatArray  #: (m,) of the joints' speeds
    rate: FloatArray  #: (m,) of the rate of turn

    @classmethod
    def full(cls, points: int) -> Parts:
        """Return the parts of a first program."""
        return cls(np.full(points, _PART), np.full(points, _PART))

    def lower(self, speed: FloatArray, rate: FloatArray) -> Parts:
        """Return the parts after a turn whose needs (m,), relative to the limits, exceed 1 on some lines."""
        lower = (
            np.where(need > 1.0, part * _AGAIN / np.maximum(need, 1.0), part)
            for part, need in ((self.speed, speed), (self.rate, rate))
        )
        return Parts(*lower)


@dataclass(frozen=True, eq=False)
class SmoothTurn:
    """A turn along a path of m points."""

    turn: FloatArray  #: (m,) turn about the spindle axis [rad]
    angles: FloatArray  #: (m, 6) start of the search for the arm's joints [rad]
    #: root mean square, or greatest, of the deflections at the places, to first order in the load [m]
    size: float


@dataclass(frozen=True, eq=False)
class TurnSmoother:
    """Smooth turns along a path of m points."""

    model: ForwardModel
    inverse: InverseKinematics
    path: ProcessPath
    limits: FloatArray  #: (m, n) greatest motion of each of the model's joints for a length [rad/m or m/m]
    rate: float  #: greatest turn for a length of the path [rad/m]
    clearance: float  #: least singular value of the flange's Jacobian, in m and rad
    spacing: float  #: distance of the knots of the choice [m]
    knots: IndexArray  #: (k,) points that are knots of the choice
    first: IndexArray  #: (m,) index of the first point that is the same target, for each point
    range: tuple[float, float] | None  #: least and greatest turn [rad]; None for any turn
    corrects: bool
    greatest: bool

    def smooth(
        self, turn: FloatArray, angles: FloatArray, roughness: float, parts: Parts, *, again: bool = False
    ) -> SmoothTurn | None:
        """Return the best smooth turn near another; None if none is found.

        Args:
            turn: (m,) turns where the search starts, without jumps along a line [rad].
            angles: (m, 6) the arm's joints there [rad].
            roughness: cost of a rough turn, one of `ROUGHNESS`.
            parts: parts of the limits that may be used.
            again: whether the start is a smooth turn, which exceeds limits by little.
        """
        trust, rounds = (_TRUST_AGAIN, _ROUNDS_AGAIN) if again else (_TRUST, _ROUNDS)
        return self._improve(turn, angles, roughness, parts, trust, rounds)

    def begin(self, turn: FloatArray, angles: FloatArray) -> SmoothTurn | None:
        """Return a smooth turn near another after the first programs alone; None if none is found.

        Args:
            turn: (m,) turns where the search starts, without jumps along a line [rad].
            angles: (m, 6) the arm's joints there [rad].
        """
        parts = Parts.full(len(self.path))
        return self._improve(turn, angles, ROUGHNESS[0], parts, _TRUST, _ROUNDS_TO_COMPARE)

    def _improve(
        self, turn: FloatArray, angles: FloatArray, roughness: float, parts: Parts, trust: float, rounds: int
    ) -> SmoothTurn | None:
        """Solve programs, each about the turn of the one before and with half of its trust [rad]."""
        from jointstiff.solver.fit.programs import solve_turns

        places = self._places
        here = self._interpolate(turn)
        q, reached = self.inverse.refine(places.turn(np.arange(len(places)), here), self._between(angles))
        if not reached.all():
            return None
        found = False
        for _ in range(rounds):
            program = self._state(turn, here, q, roughness, parts, trust)
            x = None if program is None else solve_turns(program, greatest=self.greatest)
            if x is None and (found or trust > _MOST_TRUST):
                break
            if x is None:  # the first turn is farther from a smooth one than the trust
                trust *= 2.5
                continue
            next_turn = self._basis @ x
            next_here = self._interpolate(next_turn)
            poses = places.turn(np.arange(len(places)), next_here)
            next_q, reached = self.inverse.refine(poses, q)
            if not reached.all() or np.abs(next_q - q).max() > _FARTHEST:
                trust *= 0.4
                continue
            change = float(np.abs(next_here - here).max())
            turn, here, q, found = next_turn, next_here, next_q, True
            trust *= 0.5
            if change < _SETTLED:
                break
        if not found:
            return None
        shift = self._at_points(q - self._between(angles))
        return SmoothTurn(self._snap(turn), angles + shift, self._measure(q))

    def _measure(self, q: FloatArray) -> float:
        """Return the deflection of joints q (k, 6) at the places, to first order in the load [m]."""
        sizes = self._sizes(Postures(self.inverse.arm, q))
        if self.greatest:
            return float(sizes[self._weights > 0.0].max())
        return float(np.sqrt(self._weights @ np.square(sizes)))

    def _snap(self, turn: FloatArray) -> FloatArray:
        """Return turns (m,) whose ends of the range are exact: a program's tolerance misses them."""
        for end in self.range or ():
            turn = np.where(np.abs(turn - end) < _AT_END, end, turn)
        return turn

    @property
    def _gap(self) -> float:
        """Greatest distance of two places [m]."""
        return min(_PLACES, _SPREAD * self.spacing / _PLACES_A_KNOT)

    @cached_property
    def _lines(self) -> tuple[IndexArray, FloatArray]:
        """Places along the lines: (k,) points to which the lines lead, and (k,) fractions of the lines.

        A point without a line is a place of its own, at the end of no line.
        """
        path = self.path
        lengths, last, fraction, gap = path.lengths, list[int](), list[float](), self._gap
        is_knot = np.zeros(len(path), dtype=np.bool_)
        is_knot[self.knots] = True
        for part in path.stretches:
            reached = -np.inf
            last.append(part.start)
            fraction.append(1.0)
            for i in range(part.start + 1, part.stop):
                step = path.steps[i]
                if step <= 0.0:
                    continue
                if reached == -np.inf or is_knot[i - 1]:  # a line begins anew behind a knot
                    last.append(i)
                    fraction.append(0.0)
                    reached = lengths[i - 1]
                while reached + gap < lengths[i] - 1e-9:
                    reached = reached + gap
                    last.append(i)
                    fraction.append(float(np.clip((reached - lengths[i - 1]) / step, 0.0, 1.0)))
                if is_knot[i]:
                    last.append(i)
                    fraction.append(1.0)
                    reached = lengths[i]
        return np.array(last, dtype=np.intp), np.array(fraction)

    @cached_property
    def _is_line(self) -> BoolArray:
        """(k,) mask of the places that are on a line."""
        return np.asarray(self.path.steps[self._lines[0]] > 0.0)

    @cached_property
    def _places(self) -> ProcessPath:
        """The path at the places."""
        return self.path.interpolate(*self._lines)

    @cached_property
    def _weights(self) -> FloatArray:
        """(k,) weights of the places, with the sum 1: by the length around each place, under load."""
        last, fraction = self._lines
        at = self.path.lengths[last] - (1.0 - fraction) * self.path.steps[last]
        number = np.cumsum(~self.path.continuous)[last]
        gap = np.where(number[1:] == number[:-1], np.diff(at), 0.0)
        weight = 0.5 * (np.append(0.0, gap) + np.append(gap, 0.0))
        places = self._places
        counted = places.loaded if places.loaded.any() else np.ones(len(places), dtype=np.bool_)
        alone = np.bincount(number)[number] == 1
        mean = weight[counted & ~alone].mean() if (counted & ~alone).any() else 1.0
        weight = np.where(alone, mean, weight) * counted
        total = weight.sum()
        return np.asarray(weight / total if total > 0.0 else np.full(len(weight), 1.0 / len(weight)))

    @cached_property
    def _splines(self) -> tuple[csr_array, csr_array]:
        """Matrix (m, p) from the unknowns to the turns at the points, and rows (r, p) of the roughness."""
        bases, rough = [], []
        whole = max(float(self.path.lengths[-1]), 1e-9)
        for part in self.path.stretches:
            lengths = self.path.lengths[part]
            lengths = lengths - lengths[0]
            end = float(lengths[-1])
            distinct, which = np.unique(np.round(lengths, 12), return_inverse=True)
            count = int(np.ceil(end / (_SPREAD * self.spacing))) + 3
            if len(distinct) <= max(count, 4):  # few points: their turns are the unknowns
                identity = np.eye(len(distinct))
                bases.append(csr_array(identity[which]))
                rough.append(csr_array(_second_differences(distinct, whole)))
                continue
            inner = np.linspace(0.0, end, count - 2)
            ends = [0.0] * 3, [end] * 3
            spline = BSpline(np.concatenate([ends[0], inner, ends[1]]), np.eye(count), 3)
            bases.append(csr_array(spline(lengths)))
            at = np.linspace(0.0, end, 2 * count)
            rows = spline.derivative(2)(at) * np.sqrt(end / len(at) / whole)
            rough.append(csr_array(rows))
        return csr_array(block_diag(bases)), csr_array(block_diag(rough))

    @property
    def _basis(self) -> csr_array:
        """(m, p) matrix from the unknowns to the turns at the points [rad]."""
        return self._splines[0]

    @cached_property
    def _place_bases(self) -> tuple[csr_array, csr_array]:
        """Matrices (k, p) from the unknowns to turn and rate at the places [rad, rad/m]."""
        last, fraction = self._lines
        before = np.maximum(last - 1, 0)
        start, end = self._basis[before], self._basis[last]
        turn = diags_array(1.0 - fraction) @ start + diags_array(fraction) @ end
        step = self.path.steps[last]
        inverse = np.divide(1.0, step, out=np.zeros(len(step)), where=step > 0.0)
        return csr_array(turn), csr_array(diags_array(inverse) @ (end - start))

    def _interpolate(self, values: FloatArray) -> FloatArray:
        """Return values (k,) at the places from those (m,) at the points."""
        last, fraction = self._lines
        before = np.where(self._is_line, last - 1, last)
        return np.asarray((1.0 - fraction) * values[before] + fraction * values[last])

    def _spread(self, parts: FloatArray) -> FloatArray:
        """Return the least of parts (m,) of the lines up to the next place, for each place (k,)."""
        last, fraction = self._lines
        gap = self._gap
        lengths, steps = self.path.lengths, self.path.steps
        at = lengths[last] - (1.0 - fraction) * steps[last]
        least = parts[last]
        for i in np.flatnonzero(parts < _PART).tolist():
            near = slice(*np.searchsorted(at, [lengths[i] - steps[i] - gap, lengths[i] + gap]))
            least[near] = np.minimum(least[near], parts[i])
        return least

    def _between(self, angles: FloatArray) -> FloatArray:
        """Return angles (k, 6) at the places from those (m, 6) at the points."""
        return np.stack([self._interpolate(column) for column in angles.T], axis=1)

    def _at_points(self, shift: FloatArray) -> FloatArray:
        """Return values (m, 6) at the points, interpolated from those (k, 6) at the places."""
        last, fraction = self._lines
        at = self.path.lengths[last] - (1.0 - fraction) * self.path.steps[last]
        number = np.cumsum(~self.path.continuous)
        # Lines behind a motion of the joints are moved apart, so that nothing is interpolated across it.
        apart = 1.0 + float(self.path.lengths[-1])
        return np.stack(
            [np.interp(self.path.lengths + apart * number, at + apart * number[last], c) for c in shift.T],
            axis=1,
        )

    def _state(
        self,
        turn: FloatArray,
        here: FloatArray,
        q: FloatArray,
        roughness: float,
        parts: Parts,
        trust: float,
    ) -> TurnProgram | None:
        """Return the convex program about a turn; None where the arm is singular or does not follow."""
        from jointstiff.solver.fit.programs import TurnProgram

        places = self._places
        numbers = np.arange(len(places))
        rate = self._find_rates(turn)
        try:
            at = Postures(self.inverse.arm, q)
            by_turn, along = self._differentiate(at)
            step = _STEP * by_turn
            q_plus, plus_reached = self.inverse.refine(places.turn(numbers, here + _STEP), q + step)
            q_minus, minus_reached = self.inverse.refine(places.turn(numbers, here - _STEP), q - step)
            if not (plus_reached & minus_reached).all():
                return None
            plus, minus = (Postures(self.inverse.arm, each) for each in (q_plus, q_minus))
            change = self._find_motion(plus, rate) - self._find_motion(minus, rate)
        except np.linalg.LinAlgError:
            return None
        sizes = [np.square(self._sizes(each)) for each in (minus, at, plus)]
        mean = max(float(self._weights @ sizes[1]), np.finfo(float).tiny)
        slope = (sizes[2] - sizes[0]) / (2.0 * _STEP * mean)
        curvature = (sizes[2] - 2.0 * sizes[1] + sizes[0]) / (_STEP**2 * mean)
        basis, rate_basis = self._place_bases
        limits = _Rows()
        lines = self._is_line
        motion = _Motion(here, rate, by_turn, along, change / (2.0 * _STEP))
        self._limit_speeds(limits, motion, self._spread(parts.speed), trust)
        limits.keep(rate_basis[lines], self._spread(parts.rate)[lines] * self.rate)
        self._limit_positions(limits, here, at, by_turn, trust)
        self._limit_singularity(limits, here, (minus, at, plus))
        limits.within(basis, here - trust, here + trust)
        if self.range is not None:
            low, high = self.range
            limits.within(basis, np.minimum(low, here), np.maximum(high, here))
        equal, values = self._equations(turn)
        rough = np.sqrt(roughness) * self._splines[1]
        return TurnProgram(
            basis=basis,
            turn=here,
            size=sizes[1] / mean,
            slope=slope,
            curvature=np.maximum(curvature, _LEAST_CURVATURE),
            weight=self._weights,
            roughness=rough,
            rows=limits.matrix(basis.shape[1]),
            bounds=limits.bound(),
            equal=equal,
            values=values,
        )

    def _find_rates(self, turn: FloatArray) -> FloatArray:
        """Return the rates (k,) of turns (m,) at the places [rad/m]; zero without a line."""
        last = self._lines[0]
        before = np.where(self._is_line, last - 1, last)
        change = np.where(self._is_line, turn[last] - turn[before], 0.0)
        return np.asarray(change / np.where(self._is_line, self.path.steps[last], 1.0))

    def _differentiate(self, at: Postures) -> tuple[FloatArray, FloatArray]:
        """Return the motions (k, 6) of the arm's joints by the turn [rad/rad], and along the path [rad/m]."""
        places = self._places
        jacobian = at.pose_jacobian_at(at.to_base(places.place[:, None]))
        motion = np.zeros((len(at), 6, 2))
        motion[:, 3:, 0] = places.axes
        motion[:, :, 1] = self._twists
        solved = np.linalg.solve(jacobian, motion)
        return np.asarray(solved[..., 0], np.float64), np.asarray(solved[..., 1], np.float64)

    def _find_motion(self, at: Postures, rate: FloatArray) -> FloatArray:
        """Return the motions (k, 6) of the arm's joints for a length, at rates (k,) of turn [rad/m]."""
        by_turn, along = self._differentiate(at)
        return along + by_turn * rate[:, None]

    @cached_property
    def _twists(self) -> FloatArray:
        """(k, 6) motion of the tool's centre and turn of the tool at turn zero, for a length of the path."""
        path, last = self.path, self._lines[0]
        before = np.where(self._is_line, last - 1, last)
        step = np.where(self._is_line, path.steps[last], 1.0)[:, None]
        centres, rotation = path.centres, path.poses[:, :3, :3]
        moved = (centres[last] - centres[before]) / step
        turned = rotation_vectors(rotation[last], rotation[before]) / step
        return np.concatenate([moved, turned], axis=1)

    def _sizes(self, at: Postures) -> FloatArray:
        """Return the lengths (k,) of the deflections at the places, to first order in the load [m]."""
        whole = self._add_held_joints(at)
        joints = self.model.robot.joint_map.controller_angles(whole.q)
        cases = self._places.cases(np.arange(len(at)), joints)
        return np.asarray(np.linalg.norm(self.model.linear_displacement(cases, whole), axis=1))

    def _add_held_joints(self, at: Postures) -> Postures:
        """Return postures of the whole robot: those of the arm, and its linear axes where they are held."""
        robot = self.model.robot
        if robot.n == self.inverse.arm.n:
            return at
        return Postures(robot, self.inverse.insert_held_joints(at.q, of_model=True))

    def _limit_speeds(self, limits: _Rows, motion: _Motion, part: FloatArray, trust: float) -> None:
        """Limit ``|∂q/∂s + ∂q/∂φ φ'|``, to first order in φ and φ'; where it exceeds the limit, by steps."""
        basis, rate_basis = self._place_bases
        allowed = part[:, None] * self.limits[self._lines[0]][:, self.inverse.revolute]
        for j in range(motion.by_turn.shape[1]):
            along, by_turn, slope = motion.along[:, j], motion.by_turn[:, j], motion.slope[:, j]
            present = along + by_turn * motion.rate
            needed = np.minimum(np.abs(along), np.abs(present)) - _NEARER * trust * np.abs(slope)
            most = np.maximum(allowed[:, j], needed)
            greatest = np.abs(along) + np.abs(by_turn) * self.rate + np.abs(slope) * trust
            rows = np.flatnonzero(self._is_line & (greatest > most))
            matrix = diags_array(by_turn[rows]) @ rate_basis[rows] + diags_array(slope[rows]) @ basis[rows]
            offset = along[rows] - slope[rows] * motion.here[rows]
            limits.within(csr_array(matrix), -most[rows] - offset, most[rows] - offset)

    def _limit_positions(
        self, limits: _Rows, here: FloatArray, at: Postures, by_turn: FloatArray, trust: float
    ) -> None:
        """Keep joints, and corrected joints, within their limits with room."""
        q, shift = at.q, np.zeros_like(at.q)
        if self.corrects:
            goal = self._add_held_joints(at)
            joints = self.model.robot.joint_map.controller_angles(goal.q)
            cases = self._places.cases(np.arange(len(q)), joints)
            commanded = self.model.compute_commands(cases, goal, np.ones(len(q)))
            shift = self.inverse.select_arm_joints(commanded) - q
        low, high = self.inverse.arm.limits.T
        least = low + 1.1 * ROOM - np.minimum(shift, 0.0) - q
        most = high - 1.1 * ROOM - np.maximum(shift, 0.0) - q
        basis = self._place_bases[0]
        for j in range(q.shape[1]):
            reach = np.abs(by_turn[:, j]) * 1.5 * trust
            rows = np.flatnonzero((least[:, j] > -reach) | (most[:, j] < reach))
            offset = by_turn[rows, j] * here[rows]
            matrix = diags_array(by_turn[rows, j]) @ basis[rows]
            lower, upper = np.minimum(least[rows, j], 0.0), np.maximum(most[rows, j], 0.0)
            limits.within(matrix, lower + offset, upper + offset)

    def _limit_singularity(
        self, limits: _Rows, here: FloatArray, near: tuple[Postures, Postures, Postures]
    ) -> None:
        """Keep the least singular value beyond the clearance, to first order in the turn."""
        minus, value, plus = (np.linalg.svd(each.flange_jacobian, compute_uv=False)[:, -1] for each in near)
        slope = (plus - minus) / (2.0 * _STEP)
        rows = np.flatnonzero(value < _NEAR * self.clearance)
        room = np.maximum(value[rows] - CLEARANCE_ROOM * self.clearance, 0.0)
        matrix = diags_array(-slope[rows]) @ self._place_bases[0][rows]
        limits.add(matrix, room - slope[rows] * here[rows])

    def _equations(self, turn: FloatArray) -> tuple[csr_array, FloatArray]:
        """Return rows (e, p) and values (e,): equal turns at equal targets, and those of given joints."""
        basis = self._basis
        again = np.flatnonzero(self.first != np.arange(len(self.first)))
        given = np.flatnonzero(~np.isnan(self.path.given[:, 0]))
        again = np.setdiff1d(again, given)
        difference = turn[again] - turn[self.first[again]]
        rows = vstack([basis[again] - basis[self.first[again]], basis[given]])
        values = np.concatenate([difference, turn[given]])
        return csr_array(rows), 2.0 * np.pi * np.round(values / (2.0 * np.pi))


@dataclass(frozen=True, eq=False)
class _Motion:
    """Motion of the joints at k places, to first order in the turn and its rate."""

    here: FloatArray  # (k,) turn [rad]
    rate: FloatArray  # (k,) rate of turn [rad/m]
    by_turn: FloatArray  # (k, 6) motion by the turn [rad/rad]
    along: FloatArray  # (k, 6) motion for a length of the path, without a rate of turn [rad/m]
    slope: FloatArray  # (k, 6) change of the whole motion for a length by the turn [rad/m per rad]


class _Rows:
    """Linear limits ``A x ≤ b`` that are collected."""

    def __init__(self) -> None:
        self._matrices = list[csr_array]()
        self._bounds = list[FloatArray]()

    def add(self, matrix: csr_array, bound: FloatArray) -> None:
        """Add ``matrix @ x ≤ bound``."""
        if len(bound):
            self._matrices.append(csr_array(matrix))
            self._bounds.append(bound)

    def within(self, matrix: csr_array, low: FloatArray, high: FloatArray) -> None:
        """Add ``low ≤ matrix @ x ≤ high``."""
        self.add(matrix, high)
        self.add(-matrix, -low)

    def keep(self, matrix: csr_array, most: FloatArray) -> None:
        """Add ``|matrix @ x| ≤ most``."""
        self.within(matrix, -most, most)

    def matrix(self, columns: int) -> csr_array:
        """Return A."""
        return csr_array(vstack(self._matrices)) if self._matrices else csr_array((0, columns))

    def bound(self) -> FloatArray:
        """Return b."""
        return np.concatenate(self._bounds) if self._bounds else np.zeros(0)


def _second_differences(lengths: FloatArray, whole: float) -> FloatArray:
    """Return rows (k − 2, k) of the second derivatives of k values by length, weighted by length."""
    rows = np.zeros((max(len(lengths) - 2, 1), len(lengths)))
    for i in range(len(lengths) - 2):
        before, after = np.diff(lengths[i : i + 3])
        weight = np.sqrt(0.5 * (before + after) / whole)
        slopes = np.array([1.0 / before, -1.0 / before - 1.0 / after, 1.0 / after])
        rows[i, i : i + 3] = weight * slopes * 2.0 / (before + after)
    return rows
