"""Causes of what joints alone leave unexplained compete, and gross mistakes are undone (method.md §7, §13).

A load point elsewhere, a forgotten force, a load cell's zero, some loads heavier than others, play in the
gears, a tracker or base that moved: each is a term in addition to the joints, which are fitted with K_c to
the targets' rows, without bounds. One triangle of all terms answers every F test. Each test is made twice,
with the weights stated and with equal weights, and the larger p-value counts: a noise of the wrong shape
would accuse clean springs. Causes with a significant test are fitted by Gauss-Newton, and compared by the
Bayesian information criterion (Schwarz 1978), with bending links among them; a difference of less than
`AS_WELL` is a tie. Mistakes are tested before links: added to columns of links, their tests accuse clean
campaigns of elastic arms, and without these tests a load point elsewhere looks like links.

A *gross mistake* leaves numbers plausible: columns exchanged, a wrong joint map, the load as target. Each
such alternative is one more regressor of the same deflections: ``q = M (E q_c + e) + o`` with E exchanging,
reversing or coupling the controller's angles, e offsetting them by quarter turns, as makers' conventions are,
or the load at a target's place. As it has as many parameters as the fit itself, their residual sums compare
directly.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from itertools import combinations, product
from typing import Final, Literal

import numpy as np
from scipy import special

from jointstiff.schemas.joints import JointKind
from jointstiff.schemas.options import ElasticModel
from jointstiff.schemas.run import CauseTest
from jointstiff.solver.arrays import BoolArray, FloatArray, IndexArray
from jointstiff.solver.errors import RequestError, SolverError
from jointstiff.solver.estimation.estimate import Estimate
from jointstiff.solver.estimation.observability import Excitation
from jointstiff.solver.estimation.stack import Stack
from jointstiff.solver.estimation.triangle import (
    INDEPENDENT,
    Triangle,
    basis,
    nonnegative,
    side_by_side,
    triangle_of,
)
from jointstiff.solver.mechanics.block import (
    CorrectedMeasurements,
    FittedErrors,
    RegressorBlock,
    Rows,
    Term,
    fitted_errors,
    regressor_blocks,
    rows_of,
    targets_in_flange,
    unloaded_block,
    whitened_rows,
)
from jointstiff.solver.mechanics.measurements import Measurements
from jointstiff.solver.mechanics.postures import Postures
from jointstiff.solver.mechanics.robot import Robot
from jointstiff.solver.mechanics.springs import DIAGONAL_BASE, DIAGONAL_LINKS, FULL_BASE, JOINTS
from jointstiff.solver.mechanics.terms import FORCE_SCALE, SHIFT, TERMS, load_scale, since, turn_about

MISTAKE_LEVEL: Final = 1e-5
"""Probability that noise alone makes any cause of a set, or a base, speak."""
LINKS_LEVEL: Final = 3e-3
"""p-value below which links are worth a cross-validation."""
CLEAR_GAIN: Final = 2.0
"""Gain in paired standard errors above which joints alone do not fit."""
AS_WELL: Final = 6.0
"""Difference of the information criterion below which neither of two causes is preferred."""
_REFITS: Final = 6
"""Largest number of Gauss-Newton steps towards a cause."""
_STEADY: Final = 1e-3
"""Relative step at which they end."""
_LEADING: Final = 12
"""Number of combinations of link compliances that are tested: those that deflect most."""
_TESTED: Final = 500
"""Number of observations that suffice for the tests."""
_LEAST_PART: Final = 4
"""Least number of observations before and after something came about, or under one of several loads."""
_DISTINCT: Final = 0.03
"""Relative difference of two loads from which on they are distinct."""
_MOST_LOADS: Final = 6
"""Largest number of distinct loads of a set that may each have a scale of their own."""


@dataclass(frozen=True)
class Suspect:
    """Something that may have moved the targets in addition to the joints."""

    name: str  #: name of the cause
    term: Term  #: how it moves them
    first: str | None = None  #: label of the first observation that it concerns; None for all
    tried: int = 1  #: number of observations from which on it may have come about
    least_p: float = 0.0  #: p-value without the observation that it explains most: one may be a wrong reading


@dataclass(frozen=True, eq=False)
class Cause:
    """A cause that was followed to what it explains most."""

    suspect: Suspect
    unknowns: FloatArray  #: (k,) in the term's unit
    p_value: float  #: of its F test
    links_p_value: float  #: p-value of the F test of links added to it
    compliance: FloatArray  #: (n,) of the joints fitted with it [rad/(N·m)]
    ratio: float  #: sum of squared residuals with it, over that without
    criterion: float  #: information criterion; the least is preferred

    @property
    def proved(self) -> bool:
        """Return True if nothing is left for links to explain."""
        return self.links_p_value >= LINKS_LEVEL


@dataclass(frozen=True)
class HeldOutGain:
    """Mean residual of held-out postures: the best model with links or coupling, and joints alone."""

    model: ElasticModel
    error: float  #: mean length of the residuals of that model [m]
    error_of_joints: float  #: mean length of the residuals of joints alone [m]
    standard_error: float  #: of the difference, paired by posture [m]


@dataclass(frozen=True, eq=False)
class Screening:
    """Outcome of the tests."""

    links_p_value: float  #: of the test of links added to the joints; 1 where the readings cannot decide
    tests: tuple[CauseTest, ...]  #: of all causes, the most significant first; none where none could be made
    causes: tuple[Cause, ...]  #: the cause that explains most, and those that explain as much; none, or few
    gain: HeldOutGain | None = None  #: gain of the cross-validation; None where none was run
    base_p_value: float = 1.0  #: p-value of the test of a base added to the joints
    #: p-value of the test of links added to joints and base, and of a base added to joints and links; of a
    #: base that its own test speaks for
    links_beside_base: float = 1.0
    base_beside_links: float = 1.0
    comparable: bool = True  #: whether the options allow for comparing joints alone with elastic links

    @property
    def proved(self) -> bool:
        """Return True if causes are named that leave nothing for links to explain."""
        return bool(self.causes) and all(cause.proved for cause in self.causes)

    @property
    def lack_of_fit(self) -> bool:
        """Return True if links explain the readings better: on held-out postures, if these were compared."""
        proved, gain = self.links_p_value < MISTAKE_LEVEL, self.gain
        if gain is not None:
            proved = gain.error_of_joints - gain.error > CLEAR_GAIN * gain.standard_error
        return self.links_speak and proved

    @property
    def links_speak(self) -> bool:
        """Return True if links are worth a cross-validation: no proved cause explains them."""
        return self.links_p_value < LINKS_LEVEL and not self.proved

    @property
    def base_speaks(self) -> bool:
        """Return True if a base that bends is worth a cross-validation: no proved cause explains it."""
        return self.base_p_value < MISTAKE_LEVEL and not self.proved


def screen_estimate(robot: Robot, measurements: Measurements, estimate: Estimate) -> Screening:
    """Test what an identification of joints alone leaves unexplained; encoders take no part.

    Without a balance under the load, or without residual freedom, no test is significant. Causes that were
    fitted with the joints already stay in the fit.
    """
    part, compliance = measurements.evenly(_TESTED), np.maximum(estimate.compliance, 0.0)
    balanced = compliance if estimate.balanced is None else np.maximum(estimate.balanced, 0.0)
    try:
        block = next(regressor_blocks(robot, part, balanced))
    except SolverError:  # no balance: other reasons say so
        return Screening(1.0, (), ())
    before, seen = fitted_errors(measurements).terms, ~estimate.observability.null
    suspects = _suspects(measurements, block, compliance, before)
    triangles = _Triangles(block, compliance, seen, before, [suspect.term for suspect in suspects])
    links = triangles.links_p_value()
    *p_values, base = triangles.p_values([*(s.term.name for s in suspects), DIAGONAL_BASE.name])
    tests = {s: min(1.0, s.tried * max(s.least_p, p)) for s, p in zip(suspects, p_values, strict=True)}
    ordered = sorted(suspects, key=tests.__getitem__)
    causes: list[Cause] = []
    for suspect in ordered:
        if tests[suspect] < MISTAKE_LEVEL / len(suspects):
            with suppress(SolverError):  # it leads to loads that no arm balances
                causes.append(_follow_cause(robot, part, triangles, suspect, tests[suspect]))
    causes.sort(key=lambda cause: -cause.criterion)
    of_name = {cause.suspect.name: cause for cause in causes}  # the best of each
    best = min((cause.criterion for cause in causes), default=np.inf)
    named = tuple(cause for cause in reversed(of_name.values()) if cause.criterion <= best + AS_WELL)
    if links < LINKS_LEVEL and triangles.links_criterion() < best - AS_WELL:
        named = tuple(cause for cause in named if cause.proved)
    listed = tuple(CauseTest(name=each.name, first=each.first, p_value=tests[each]) for each in ordered)
    if base >= MISTAKE_LEVEL:
        return Screening(links, listed, named, base_p_value=base)
    with_base = _Triangles(block, compliance, seen, before, [FULL_BASE])
    return Screening(
        links,
        listed,
        named,
        base_p_value=base,
        links_beside_base=with_base.links_p_value(FULL_BASE.name),
        base_beside_links=triangles.p_values([DIAGONAL_BASE.name], DIAGONAL_LINKS.name)[0],
    )


def fit_causes(
    robot: Robot, measurements: Measurements, named: Sequence[tuple[str, str | None]]
) -> Measurements:
    """Return the readings without the motion by causes, fitted with the joints; their uncertainty goes along.

    Args:
        robot: n joints.
        measurements: N observations.
        named: name of each cause, and label of the first observation that it concerns; None for all.

    Raises:
        RequestError: the readings do not show such a cause, or it leads to loads that no arm balances.
    """
    if not named:
        return measurements
    try:
        return _fit_named(robot, measurements, named)
    except SolverError as error:
        remedy = "omit the cause, and check the units of force and length"
        raise RequestError(error.reason, where="causes", remedy=remedy) from error


def _fit_named(
    robot: Robot, measurements: Measurements, named: Sequence[tuple[str, str | None]]
) -> Measurements:
    """Return the readings without what causes moved.

    Raises:
        RequestError: the readings do not show such a cause.
        SolverError: it leads to loads that no arm balances.
    """
    part = measurements.evenly(_TESTED)
    block = next(regressor_blocks(robot, part))
    rows = Stack.of([block], [JOINTS], np.zeros(robot.n)).flat
    compliance, _ = nonnegative(rows[:, :-1], rows[:, -1])
    named = [(name, first) for name, first in named if name != "shift" or ("turn", first) not in named]
    firsts = [first for _, first in named if first is not None]
    known = {(s.name, s.first): s for s in _suspects(measurements, block, compliance, (), firsts)}
    missing = next((each for each in named if each not in known), None)
    if missing is not None:
        since_first = f" since observation '{missing[1]}'" if missing[1] else ""
        raise RequestError(
            f"the readings have nothing that shows '{missing[0]}'{since_first}",
            where="causes",
            remedy=f"give one of: {', '.join(sorted({name for name, _ in known}))}",
        )
    fitted = _fit(robot, part, [known[each].term for each in named], compliance)
    corrected = _take_out(robot, measurements, fitted.errors, fitted.compliance)
    return CorrectedMeasurements.of(corrected, fitted.errors)


@dataclass(frozen=True, eq=False)
class _Fitted:
    """Causes fitted with the joints."""

    errors: FittedErrors
    compliance: FloatArray  # (n,) of the joints fitted with them
    triangles: _Triangles  # of the readings without them


def _fit(robot: Robot, part: Measurements, terms: Sequence[Term], compliance: FloatArray) -> _Fitted:
    """Fit causes with the joints by Gauss-Newton.

    Combinations that the joints explain as well stay zero, and are as uncertain as the others are large.

    Raises:
        SolverError: they lead to loads that no arm balances.
    """
    now, unknowns, size = part, np.zeros(()), np.zeros(0)
    for _ in range(_REFITS):
        block = next(regressor_blocks(robot, now, compliance))
        # a load elsewhere may twist joints that it did not
        excitation = Excitation(robot.joint_kinds)
        excitation.add(block)
        seen = ~excitation.observability().null
        triangles = _Triangles(block, compliance, seen, terms, ())
        found = triangles.stated.fit_with([term.name for term in terms])
        compliance = np.zeros(robot.n)
        compliance[seen] = np.maximum(found.known, 0.0)
        ends = np.cumsum([len(triangles.stated.span[term.name]) for term in terms])[:-1]
        before, unknowns = unknowns, unknowns + found.unknowns
        if not size.any():
            own = np.split(unknowns, ends)
            size = np.concatenate([np.full(len(each), np.sqrt(np.mean(each**2)) or 1.0) for each in own])
        hidden = np.linalg.qr(found.hidden / size[:, None])[0]
        unknowns = unknowns - size * (hidden @ (hidden.T @ (unknowns / size)))
        root = np.hstack([triangles.sigma * found.root, size[:, None] * hidden])
        determined = found.root.shape[1]
        errors = FittedErrors(tuple(terms), tuple(np.split(unknowns, ends)), root, determined)
        fitted = _Fitted(errors, compliance, triangles)
        if np.linalg.norm((unknowns - before) / size) <= _STEADY * np.linalg.norm(unknowns / size):
            break
        now = _take_out(robot, part, errors, compliance)
    return fitted


def _follow_cause(
    robot: Robot, part: Measurements, triangles: _Triangles, suspect: Suspect, p_value: float
) -> Cause:
    """Follow a cause to what it explains most.

    Raises:
        SolverError: it leads to loads that no arm balances, or to a negative size of what has none.
    """
    fitted = _fit(robot, part, [*fitted_errors(part).terms, suspect.term], triangles.compliance)
    unknowns = fitted.errors.unknowns[-1]
    surest = unknowns / np.linalg.norm(fitted.errors.root, axis=1)[-len(unknowns) :]
    if suspect.term.nonnegative and surest[np.abs(surest).argmax()] < 0.0:
        raise SolverError(
            f"{suspect.name} would be negative", where="causes", remedy="look for another cause"
        )
    left = fitted.triangles.residual_squares()
    return Cause(
        suspect,
        unknowns,
        p_value,
        fitted.triangles.links_p_value(),
        fitted.compliance,
        left / triangles.residual_squares(),
        fitted.triangles.criterion(left, fitted.errors.determined + (suspect.first is not None)),
    )


def _take_out(
    robot: Robot, measurements: Measurements, errors: FittedErrors, compliance: FloatArray
) -> Measurements:
    """Return the readings without what errors moved, at a compliance (n,) of the joints."""
    pairs = list(zip(errors.terms, errors.unknowns, strict=True))
    for term, own in pairs:
        if term.under is not None:
            measurements = term.under(robot, measurements, own)
    pairs = [(term, own) for term, own in pairs if term.under is None]
    if not pairs:
        return measurements
    targets, joints = [], []
    for block in regressor_blocks(robot, measurements, compliance):
        motions = [(term.motion(block, compliance), own) for term, own in pairs]
        targets.append(np.sum([motion.targets @ own for motion, own in motions], axis=0))
        turned = [motion.joints @ own for motion, own in motions if motion.joints is not None]
        joints.append(np.sum([np.zeros_like(block.torque), *turned], axis=0))
    moved = np.where(measurements.present[..., None], np.concatenate(targets), 0.0)
    encoders = measurements.encoders
    if encoders is not None:
        behind = np.where(encoders.present, encoders.deflection - np.concatenate(joints), 0.0)
        encoders = replace(encoders, deflection=behind)
    return replace(measurements, deflection=measurements.deflection - moved, encoders=encoders)


def _suspects(
    measurements: Measurements,
    block: RegressorBlock,
    compliance: FloatArray,
    before: Sequence[Term],
    firsts: Sequence[str] | None = None,
) -> list[Suspect]:
    """Return what may have moved the targets of a set.

    Args:
        measurements: N observations.
        block: some of them.
        compliance: (n,) of the joints.
        before: terms that are fitted in any case.
        firsts: labels of observations from which on something came about; None to look for them.
    """
    part, labels, loads = block.measurements, measurements.labels, _distinct_loads(measurements)
    tried = len(part) - 2 * _LEAST_PART + 1
    turn = turn_about(block.points[part.present].mean(axis=0))
    later = {SHIFT.name: SHIFT, turn.name: turn, FORCE_SCALE.name: load_scale([labels])}
    own = [load_scale(loads)] if len(loads) > 1 else []
    found = [Suspect(t.name, t) for t in (*TERMS.values(), turn, *own) if t.suspected]
    if firsts is not None:
        known = [first for first in firsts if first in labels]
        found += [Suspect(t.name, since(t, labels, first), first) for t in later.values() for first in known]
    else:
        terms = [*(each.term for each in found), FORCE_SCALE]
        stack = Stack.of([block], [JOINTS, *before, *terms], compliance)
        parts = _Since(stack, [term.name for term in terms], [term.name for term in (JOINTS, *before)])
        least = parts.least_p(np.zeros(len(terms), np.intp))
        found = [replace(each, least_p=p) for each, p in zip(found, least.tolist(), strict=False)]
        if tried > 0:
            rows = parts.came_about()
            for each, row, p in zip(terms, rows.tolist(), parts.least_p(rows).tolist(), strict=True):
                if each.name in later:
                    term, first = later[each.name], part.labels[row]
                    found.append(Suspect(term.name, since(term, labels, first), first, tried, p))
    return [suspect for suspect in found if suspect.term.name not in {term.name for term in before}]


def _distinct_loads(measurements: Measurements) -> list[list[str]]:
    """Return labels of the observations under each of few distinct loads, by their size."""
    size = np.hypot(np.linalg.norm(measurements.force, axis=1), np.linalg.norm(measurements.moment, axis=1))
    order = np.argsort(size, kind="stable")
    steps = 1 + np.flatnonzero(np.diff(size[order]) > _DISTINCT * size[order][1:])
    groups = [group for group in np.split(order, steps) if len(group) >= _LEAST_PART]
    if len(groups) > _MOST_LOADS:
        return []
    return [[measurements.labels[i] for i in group.tolist()] for group in groups]


class _Since:
    """Fits of S terms from each of N observations on, each together with the joints and other terms.

    Columns have unit length over all observations.
    """

    def __init__(self, stack: Stack, names: Sequence[str], known: Sequence[str]) -> None:
        """Fit each term from each observation on.

        Args:
            stack: N observations.
            names: of the S terms.
            known: terms that are fitted in any case.
        """
        flat = stack.of_unit_columns()[0].flat
        there = basis(flat[:, np.concatenate([stack.span[name] for name in known])])
        left = stack.flat[:, -1] - there @ (there.T @ stack.flat[:, -1])
        columns = [flat[:, stack.span[name]] for name in names]
        q, self._width = there.shape[1], np.array([each.shape[1] for each in columns])
        X = side_by_side(columns)  # (S, N m, k)
        shape, k = (len(stack), -1), X.shape[-1]
        rows = np.concatenate([there, left[:, None], *X], axis=1).reshape(*shape, q + 1 + len(names) * k)
        since = Stack(rows, stack.read, {"known": q, "left": 1, "terms": len(names) * k}).grams_since
        own = (q + 1 + np.arange(len(names) * k)).reshape(len(names), k)
        shared = since[:, :q][:, :, own].transpose(2, 0, 1, 3)  # (S, N, q, k)
        alone = since[:, own[:, :, None], own[:, None]].transpose(1, 0, 2, 3) - shared.mT @ shared
        self._moment = since[:, own, q, None].transpose(1, 0, 2, 3)  # (S, N, k, 1)
        self._unknowns = np.linalg.solve(alone + INDEPENDENT * np.eye(k), self._moment)
        self._read, self._X = stack.read, X.reshape(len(names), *shape, k)
        self._known, self._left = there.reshape(*shape, q), left.reshape(*shape, 1)

    def came_about(self) -> IndexArray:
        """Return the observation (S,) since which a term explains most, with enough before and after."""
        gain = (self._moment * self._unknowns).sum(axis=(2, 3))
        allowed = gain[:, _LEAST_PART : gain.shape[1] - _LEAST_PART + 1]
        return np.asarray(_LEAST_PART + np.argmax(allowed, axis=1))

    def least_p(self, first: IndexArray) -> FloatArray:
        """Return the p-value (S,) of the terms since observations (S,), without the one they explain most."""
        count = len(self._read)
        moved = self._X @ self._unknowns[np.arange(len(first)), first][:, None]
        moved = np.where(np.arange(count)[:, None, None] >= first[:, None, None, None], moved, 0.0)
        through = self._known @ np.einsum("brk,sbrl->skl", self._known, moved)[:, None]
        before, after = np.square(self._left), np.square(self._left - moved + through)
        before, gain = before.sum(axis=(1, 2)), (before - after).sum(axis=(2, 3))
        others = np.arange(count) != np.argmax(gain, axis=1)[:, None]
        freedom = (others * self._read).sum(axis=1) - self._known.shape[-1] - self._width
        explained = np.maximum((others * gain).sum(axis=1), 0.0)
        left = np.maximum((others * before).sum(axis=1) - explained, 1e-300)
        sure = np.maximum(freedom, 1)
        p = special.fdtrc(self._width, sure, explained / self._width / (left / sure))
        return np.where(freedom < 1, 1.0, p)


class _Triangles:
    """Triangles of joints, causes and links: with the weights stated, and with equal ones where they differ.

    Attributes:
        stated: with the weights stated.
    """

    def __init__(
        self,
        block: RegressorBlock,
        compliance: FloatArray,
        seen: BoolArray,
        before: Sequence[Term],
        terms: Sequence[Term],
    ) -> None:
        """Compress a block's rows; joints that are not seen are left out."""
        self.fitted = (JOINTS.name, *(term.name for term in before))
        self.compliance = compliance
        self._block, self._seen = block, seen
        self._terms = [JOINTS, *before, *terms, DIAGONAL_LINKS, DIAGONAL_BASE]
        self.stated = self._triangle(whitened_rows)

    @cached_property
    def _equal(self) -> Triangle:
        return self._triangle(rows_of)

    def _triangle(self, weigh: Callable[..., Rows]) -> Triangle:
        triangle = Stack.of([self._block], self._terms, self.compliance, weigh).triangle()
        triangle.span[JOINTS.name] = np.flatnonzero(self._seen)
        return triangle

    def _larger_p(self, level: float, test: Callable[[Triangle], FloatArray]) -> FloatArray:
        """Return p-values of tests with the weights stated, or with equal ones where these are larger."""
        p = test(self.stated)
        if (p >= level).all() or self._block.measurements.covariance.ndim == 2:
            return p
        return np.where(p >= level, p, np.maximum(p, test(self._equal)))

    def p_values(self, names: Sequence[str], *others: str) -> list[float]:
        """Return the p-value of each term added to the joints and to others."""
        fitted = (*self.fitted, *others)
        return [*self._larger_p(MISTAKE_LEVEL, lambda triangle: triangle.p_values(names, fitted)).tolist()]

    def links_p_value(self, *others: str) -> float:
        """Return the p-value of links added to the joints and to others."""
        names, fitted = [DIAGONAL_LINKS.name], (*self.fitted, *others)
        p_values = self._larger_p(
            LINKS_LEVEL,
            lambda triangle: triangle.p_values(names, fitted, most=self._leading_count, least=INDEPENDENT),
        )
        return float(p_values[0])

    @property
    def _leading_count(self) -> int:
        return max(0, min(_LEADING, (self.stated.rows - len(self._seen)) // 3))

    @property
    def sigma(self) -> float:
        """Standard uncertainty of a coordinate by the residuals, or as stated where that is larger [m]."""
        freedom = max(1, self.stated.rows - basis(self.stated.unit_columns(self.fitted)).shape[1])
        stated = self._block.measurements.sigma or 0.0
        return max(stated, float(np.sqrt(self.residual_squares() / freedom)))

    def residual_squares(self) -> float:
        """Return the sum of squared residuals of the joints and of what is fitted in any case."""
        return max(self.stated.residual_squares(self.fitted), 1e-300)

    def criterion(self, squares: float, unknowns: int) -> float:
        """Return the Bayesian information criterion of a sum of squared residuals with more unknowns."""
        return self.stated.rows * float(np.log(squares)) + unknowns * float(np.log(self.stated.rows))

    def links_criterion(self) -> float:
        """Return the same of links: their leading combinations."""
        known = basis(self.stated.unit_columns(self.fitted))
        links = self.stated.unit_columns([DIAGONAL_LINKS.name])
        leading = basis(links - known @ (known.T @ links), INDEPENDENT)[:, : self._leading_count]
        explained = float(np.square(leading.T @ self.stated.rhs).sum())
        return self.criterion(max(self.residual_squares() - explained, 1e-300), leading.shape[1])


AlternativeKind = Literal[
    "columns_exchanged",
    "sign_reversed",
    "zero_offset",
    "joints_coupled",
    "joint_map",
    "load_and_target_exchanged",
]

FALSE_ALARM: Final = 1e-4
"""Probability that noise alone makes any alternative of a set fit better."""
LARGEST_RATIO: Final = 0.7
"""Largest ratio of the residual sums, alternative to fit: model errors favour a wrong alternative by less."""
LEAST_COMPENSATION: Final = 0.7
"""Least compensation of an alternative; below it as given, whole joint maps are tried."""
_MAPPED_JOINTS: Final = 7
"""Number of joints up to which whole joint maps are tried: their number doubles with each joint."""
_COMPARED: Final = 60
"""Number of observations that suffice to find a mistake of the whole set."""
_SCREENED: Final = 3
"""Number of coordinates for each joint in the observations that select the alternatives to examine."""
_MOST_TARGETS: Final = 8
_READINGS: Final = 24_576
"""Maximum number of readings computed: with many joints fewer observations are compared."""
_LEAST_FREEDOM: Final = 3


@dataclass(frozen=True, eq=False)
class Alternative:
    """One mistake that may have been made."""

    kind: AlternativeKind  #: kind of mistake
    joints: tuple[int, ...]  #: indices of the controller's joints concerned
    matrix: FloatArray  #: (n, n) E, the controller's angles meant from those given, dimensionless
    offset: FloatArray  #: (n,) e [rad]
    #: index of the target whose place and the load point are exchanged; None for other kinds
    target: int | None = None


@dataclass(frozen=True, eq=False)
class BetterAlternative:
    """An alternative that explains the readings far better than the set as given."""

    alternative: Alternative  #: the mistake that was undone
    ratio: float  #: residual sum of squares with it over that without
    compensation: float  #: share of the mean deflection explained with it
    compensation_as_given: float  #: the same without it


def better_alternative(robot: Robot, measurements: Measurements) -> BetterAlternative | None:
    """Return the alternative of least residual sum if neither noise nor model errors explain its gain.

    The gain must be significant by an F test in which the alternative counts as n further parameters, all
    compliances of each fit being non-negative.

    Returns:
        The alternative, or None where no alternative fits far better.
    """
    best, plain = _best_alternative(
        robot, measurements, _alternatives(robot.joint_kinds, measurements.present.shape[1])
    )
    if plain < LEAST_COMPENSATION and 2 < robot.n <= _MAPPED_JOINTS:
        mapped, _ = _best_alternative(robot, measurements, _joint_maps(robot.joint_kinds))
        best = min((b for b in (best, mapped) if b), key=lambda b: b.ratio, default=None)
    return best


def _best_alternative(
    robot: Robot, measurements: Measurements, alternatives: Sequence[Alternative]
) -> tuple[BetterAlternative | None, float]:
    """Compare alternatives: the best that is significant, and the compensation as given."""
    affordable = _READINGS // (measurements.present.shape[1] * (len(alternatives) + 1))
    part = measurements.evenly(max(1, min(_COMPARED, affordable)))
    # A rigid flange moves by six coordinates at most.
    coordinates = int(np.minimum(part.coordinates.sum(axis=1), 6).sum())
    freedom = coordinates - robot.n
    if freedom < _LEAST_FREEDOM:
        return None, 1.0
    # Noise alone goes below that ratio of residual sums with probability `FALSE_ALARM`.
    quantile = float(special.fdtri(robot.n, freedom, 1.0 - FALSE_ALARM / len(alternatives)))
    ratio = min(LARGEST_RATIO, 1.0 / (1.0 + robot.n * quantile / freedom))
    # Some of the observations select the alternatives to examine.
    some = part.evenly(math.ceil(_SCREENED * robot.n * len(part) / coordinates))
    rows = _rows(robot, some, alternatives)
    as_given, plain = _fit_nonnegative(rows[0])
    alternatives = [a for a, left in zip(alternatives, _least_sums(rows[1:]), strict=True) if left < as_given]
    if not alternatives:
        return None, plain
    rows = _rows(robot, part, alternatives)
    as_given, plain = _fit_nonnegative(rows[0])
    needed, best = as_given * ratio, None
    for k in (1 + np.flatnonzero(_least_sums(rows[1:]) < needed)).tolist():
        left, compensation = _fit_nonnegative(rows[k])
        if left < needed and compensation >= LEAST_COMPENSATION:
            best, needed = BetterAlternative(alternatives[k - 1], left / as_given, compensation, plain), left
    # Where every force is reversed, much explains more than nothing; the integrity checks find the sign.
    if best is not None and _fit_nonnegative(rows[0] * np.append(np.ones(robot.n), -1.0))[0] < needed:
        return None, plain
    return best, plain


@lru_cache
def _alternatives(kinds: tuple[JointKind, ...], targets: int) -> tuple[Alternative, ...]:
    """Return the mistakes that are compared: lengths are neither exchanged nor coupled with angles."""
    n, turning = len(kinds), [j for j, kind in enumerate(kinds) if kind == "revolute"]
    unit, none = np.eye(n), np.zeros(n)
    mistakes: list[Alternative] = []
    for j, k in ((j, k) for j, k in combinations(range(n), 2) if kinds[j] == kinds[k]):
        order = np.arange(n)
        order[[j, k]] = k, j
        mistakes.append(Alternative("columns_exchanged", (j, k), unit[order], none))
    for j, row in enumerate(unit):
        reversed_joint = unit - 2.0 * np.outer(row, row)
        mistakes.append(Alternative("sign_reversed", (j,), reversed_joint, none))
    for sign in (1.0, -1.0) if n > 2 and kinds[1] == kinds[2] else ():
        coupled = unit + sign * np.outer(unit[2], unit[1])
        mistakes.append(Alternative("joints_coupled", (1, 2), coupled, none))
    for j, turn in product(turning, (0.5 * np.pi, -0.5 * np.pi, np.pi)):
        mistakes.append(Alternative("zero_offset", (j,), unit, turn * unit[j]))
    exchanges = [
        Alternative("load_and_target_exchanged", (), unit, none, t)
        for t in range(min(targets, _MOST_TARGETS))
    ]
    return (*mistakes, *exchanges)


@lru_cache
def _joint_maps(kinds: tuple[JointKind, ...]) -> tuple[Alternative, ...]:
    """Return joint maps: the signs of some joints reversed, the third joint coupled to the second or not."""
    n, maps = len(kinds), list[Alternative]()
    unit, couplings = np.eye(n), (0.0, 1.0, -1.0) if kinds[1] == kinds[2] else (0.0,)
    for coupling, signs in product(couplings, product((1.0, -1.0), repeat=n)):
        concerned = {*np.flatnonzero(np.array(signs) < 0.0).tolist()}
        if len(concerned) + abs(coupling) > 1:
            joints = tuple(sorted(concerned | ({1, 2} if coupling else set())))
            matrix = np.diag(signs) @ (unit + coupling * np.outer(unit[2], unit[1]))
            maps.append(Alternative("joint_map", joints, matrix, np.zeros(n)))
    return tuple(maps)


def _rows(robot: Robot, given: Measurements, alternatives: Sequence[Alternative]) -> FloatArray:
    """Build the whitened rows (K + 1, R, n + 1) [A d] of the set as given, then of each alternative."""
    count, times = len(given), len(alternatives) + 1
    matrices = np.array([np.eye(robot.n), *(each.matrix for each in alternatives)])
    offsets = np.array([np.zeros(robot.n), *(each.offset for each in alternatives)])
    joints = (given.joints @ matrices.transpose(0, 2, 1) + offsets[:, None]).reshape(times * count, -1)
    at = Postures(robot, robot.joint_map.model_angles(joints))
    stacked = given[np.tile(np.arange(count), times)]
    load_point, position = stacked.load_point.copy(), stacked.position.copy()
    places = np.where(given.in_flange[..., None], given.position, targets_in_flange(robot, given))
    for k, t in enumerate((each.target for each in alternatives), 1):
        if t is not None:
            part = slice(k * count, (k + 1) * count)
            load_point[part] = places[:, t]
            position[part, t] = np.where(given.in_flange[:, t, None], given.load_point, given.position[:, t])
    block = unloaded_block(
        robot, at, replace(stacked, joints=joints, load_point=load_point, position=position)
    )
    return Stack.of([block], [JOINTS], np.zeros(robot.n)).rows.reshape(times, -1, robot.n + 1)


def _least_sums(rows: FloatArray) -> FloatArray:
    """Return no more than the residual sums (K,) of fits without bounds to rows (K, R, n + 1) [A d]."""
    return np.square(triangle_of(rows)[:, -1, -1])


def _fit_nonnegative(rows: FloatArray) -> tuple[float, float]:
    """Fit non-negative compliances to rows (R, n + 1) [A d]: residual sum of squares, and compensation."""
    A, d = rows[:, :-1], rows[:, -1]
    residual = d - A @ nonnegative(A, d)[0]
    left = np.linalg.norm(residual.reshape(-1, 3), axis=1).sum()
    moved = np.linalg.norm(d.reshape(-1, 3), axis=1).sum()
    return float(residual @ residual), float(1.0 - left / moved) if moved > 0.0 else 0.0
