"""The sequence of postures along a path with the least deflection, by dynamic programming.

The sequence is the best of all sequences of the candidates: the least sum of values (or the least greatest
value), plus a weight on changes of the turn, where joints and tool keep their limits on the line between two
points. Where no motion keeps the limits of the joints, such as on a path that is too fast, these limits are
raised on that line.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Final

import numpy as np
import numpy.typing as npt
from scipy.spatial import KDTree

from jointstiff.solver.arrays import BoolArray, FloatArray, IndexArray
from jointstiff.solver.errors import RequestError
from jointstiff.solver.process.candidates import Candidates

_NONE: Final = -1
MOST_LINKS: Final = 20_000_000
"""Greatest number of motions between the postures of a path: they take 16 bytes each."""
MOST_TRIALS: Final = 40
"""Greatest number of trials, each with one posture for a target that is visited again, along a path."""
_ROUNDING: Final = 1e-9
"""Part of a limit that is kept free, so that differences of rounded angles do not exceed the limit."""
_APART: Final = 1e3
"""Distance that exceeds each difference of two turns [rad]."""
_RAISED: Final = (1.0, 1.5, 2.5, 5.0, np.inf)
"""Factors by which the limits of the joints are raised on a line on which no motion keeps these limits."""
_LARGEST: Final = float(np.radians(60.0))
"""Greatest motion of a joint on a line [rad]: a joint that moves farther is not the same motion."""
_SMOOTHNESS: Final = 1e-4
"""Cost of a turn by 1 rad within 1 m, in units of the candidates' mean value: of equal turns, the least."""


@dataclass(frozen=True, eq=False)
class LineLimits:
    """Limits of the motion on the line to each of m points."""

    joints: FloatArray  #: (m, n) greatest motion of each of the model's joints [rad or m]
    turn: FloatArray  #: (m,) greatest turn about the spindle [rad]
    length: FloatArray  #: (m,) length of the line [m]
    closed: bool = True  #: whether a turn by 2π is no turn


@dataclass(frozen=True, eq=False)
class Links:
    """Allowed motions from the candidates of a point to those of the next, sorted by the latter."""

    first: npt.NDArray[np.int32]  # (E,) candidate of the point before, counted from its first one
    last: npt.NDArray[np.int32]  # (E,) candidate of the point
    cost: FloatArray  # (E,) cost of the change of the turn, in units of the candidates' values


@dataclass(frozen=True, eq=False)
class Trellis:
    """Candidates of m points, and the motions between them.

    Attributes:
        rows: m slices of the candidates.
        links: m − 1 motions, from each point to the next; None if the joints move freely.
        raised: factors (m,) by which the limits of the joints are raised on the line to each point.
    """

    candidates: Candidates
    rows: Sequence[slice]
    links: Sequence[Links | None]
    angles: FloatArray  # (T,) turns about the spindle axis [rad]
    raised: FloatArray

    @classmethod
    def link(
        cls, candidates: Candidates, angles: FloatArray, continuous: BoolArray, limits: LineLimits
    ) -> Trellis:
        """Find the motions between the candidates of a path.

        Args:
            candidates: candidates of the m points of the path.
            angles: (T,) turns about the spindle axis [rad].
            continuous: (m,) mask of points that are reached from the point before along a line or an arc.
            limits: limits of joints and tool on each line.

        Raises:
            RequestError: between two points of a line each motion crosses a singularity, or moves a joint
                too far; or there are too many motions.
        """
        rows = candidates.rows(len(continuous))
        links: list[Links | None] = []
        raised = np.ones(len(continuous))
        # Only candidates that are reached from the first point are tried, so that errors name a real gap.
        reached, count = np.ones(rows[0].stop - rows[0].start, dtype=np.bool_), 0
        for i in range(1, len(continuous)):
            before, here = rows[i - 1], rows[i]
            if not continuous[i]:
                links.append(None)
                reached = np.ones(here.stop - here.start, dtype=np.bool_)
                continue
            pairs = _pair_by_turn(
                candidates, angles, before, here, float(limits.turn[i]), closed=limits.closed
            )
            pairs = pairs.select(reached[pairs.first])
            moved = np.abs(candidates.angles[here][pairs.last] - candidates.angles[before][pairs.first])
            for factor in _RAISED:
                most = np.minimum(factor * np.maximum(limits.joints[i], _ROUNDING), _LARGEST)
                kept = pairs.select((moved <= most * (1.0 - _ROUNDING)).all(axis=1))
                raised[i] = factor
                if len(kept.first):
                    break
            first, last, change = kept.first, kept.last, kept.change
            if not len(first):
                _refuse_gap(candidates, before, here, np.flatnonzero(reached), i)
            count += len(first)
            if count > MOST_LINKS:
                raise RequestError(
                    f"the path has more than {MOST_LINKS:,} motions to choose from",
                    where="turns",
                    remedy="lower `turns` or `rate`, or split the path",
                )
            order = np.argsort(last, kind="stable")
            first, last, change = first[order], last[order], change[order]
            cost = _SMOOTHNESS * np.square(change) / max(float(limits.length[i]), _ROUNDING)
            links.append(Links(first.astype(np.int32), last.astype(np.int32), cost))
            reached = np.zeros(here.stop - here.start, dtype=np.bool_)
            reached[last] = True
        return cls(candidates, rows, links, angles, raised)

    def restrict(self, kept: BoolArray) -> Trellis:
        """Return a trellis of those candidates only that a mask (K,) keeps."""
        links: list[Links | None] = []
        numbers = np.cumsum(kept) - 1  # new indices of the candidates that are kept
        rows = [
            slice(int(numbers[each.start - 1]) + 1 if each.start else 0, int(numbers[each.stop - 1]) + 1)
            for each in self.rows
        ]
        for i, link in enumerate(self.links):
            if link is None:
                links.append(None)
                continue
            first, last = link.first + self.rows[i].start, link.last + self.rows[i + 1].start
            both = kept[first] & kept[last]
            first, last = numbers[first[both]] - rows[i].start, numbers[last[both]] - rows[i + 1].start
            links.append(Links(first.astype(np.int32), last.astype(np.int32), link.cost[both]))
        return Trellis(self.candidates.select(kept), rows, links, self.angles, self.raised)

    def keep_turns(self) -> Trellis:
        """Return a trellis in which each sequence has one turn: without given postures."""
        links: list[Links | None] = []
        for each, (before, here) in zip(self.links, pairwise(self.rows), strict=True):
            first, last = _turns(self.candidates, before, here)
            if each is None:
                pairs = np.argwhere(last[:, None] == first)
                source, goal = pairs[:, 1].astype(np.int32), pairs[:, 0].astype(np.int32)
                links.append(Links(source, goal, np.zeros(len(pairs))))
                continue
            same = first[each.first] == last[each.last]
            links.append(Links(each.first[same], each.last[same], each.cost[same]))
        return replace(self, links=links)

    def find_best(self, value: FloatArray, *, greatest: bool = False) -> IndexArray | None:
        """Find the sequence of the least sum of values, or of the least greatest value.

        Args:
            value: (K,) value of each candidate, such as the square of its deflection.
            greatest: whether the greatest value counts in place of the sum.

        Returns:
            (m,) indices of candidates; None if no sequence is allowed.
        """
        if any(each.start == each.stop for each in self.rows):
            return None
        total, back = self._sum(value, greatest=greatest)
        state = int(np.argmin(total))
        if not np.isfinite(total[state]):
            return None
        return np.asarray(self._trace(np.array([state]), back)[0])

    def find_best_of_turns(self, value: FloatArray, *, greatest: bool = False) -> dict[int, IndexArray]:
        """Find what `find_best` does for the last candidates of each turn, by the index of the turn."""
        if any(each.start == each.stop for each in self.rows):
            return {}
        total, back = self._sum(value, greatest=greatest)
        turns = self.candidates.turn[self.rows[-1]]
        order = np.argsort(total, kind="stable")
        order = order[np.isfinite(total[order])]
        found, first = np.unique(turns[order], return_index=True)
        return dict(zip(found.tolist(), self._trace(order[first], back), strict=True))

    def _sum(self, value: FloatArray, *, greatest: bool) -> tuple[FloatArray, list[IndexArray]]:
        """Return the least total with which each last candidate is reached, and the candidates before."""
        total, back = value[self.rows[0]], list[IndexArray]()
        for links, here in zip(self.links, self.rows[1:], strict=True):
            own = value[here]
            if links is None:
                best = int(np.argmin(total))
                before, source = np.full(len(own), total[best]), np.full(len(own), best, dtype=np.intp)
            else:
                before, source = _find_best_links(links, total, len(own), greatest=greatest)
            total = np.maximum(before, own) if greatest else before + own
            back.append(source)
        return total, back

    def _trace(self, states: IndexArray, back: list[IndexArray]) -> IndexArray:
        """Return the sequences (s, m) that end in s candidates of the last point."""
        sequences = np.empty((len(states), len(self.rows)), dtype=np.intp)
        for i in range(len(self.rows) - 1, -1, -1):
            sequences[:, i] = self.rows[i].start + states
            if i:
                states = back[i - 1][states]
        return sequences

    def find_consistent(
        self, value: FloatArray, first: IndexArray, *, greatest: bool = False
    ) -> IndexArray | None:
        """Find the best sequence in which points that are the same target have the same posture.

        Where the best of all sequences reaches a target in two postures, its postures are tried in the order
        of the least total with which a sequence passes through them, until none can be better. The sequence
        is the best one unless more than `MOST_TRIALS` trials are needed, as for many such targets.

        Args:
            value: (K,) value of each candidate.
            first: (m,) index of the first point that is the same target, for each point.
            greatest: whether the greatest value counts in place of the sum.

        Returns:
            (m,) indices of candidates; None if no sequence is found.
        """
        found = self.find_best(value, greatest=greatest)
        if found is None or (self.candidates.joints[found] == self.candidates.joints[found[first]]).all():
            return found
        search = _ConsistentSearch(first, greatest=greatest)
        simple = search.keep_first_postures(self, value, found, np.inf)
        limit = np.inf if simple is None else self.total(value, simple, greatest=greatest)
        better = search.find(self, value, limit)
        return simple if better is None else better

    def total(self, value: FloatArray, sequence: IndexArray, *, greatest: bool) -> float:
        """Return what `find_best` minimises, of a sequence (m,) of candidates: with the costs of turns."""
        values = value[sequence]
        if greatest:
            return float(values.max())
        cost = 0.0
        for links, rows, first, last in zip(
            self.links, pairwise(self.rows), sequence[:-1], sequence[1:], strict=False
        ):
            if links is not None:
                here = (links.first == first - rows[0].start) & (links.last == last - rows[1].start)
                cost += float(links.cost[here][0])
        return float(values.sum()) + cost

    def least_through(self, value: FloatArray, *, greatest: bool) -> FloatArray:
        """Return the least total (K,) of the sequences through each candidate; inf where there is none."""
        join = np.maximum if greatest else np.add
        to, after = np.full(len(value), np.inf), np.full(len(value), np.inf)
        to[self.rows[0]] = value[self.rows[0]]
        for links, (before, here) in zip(self.links, pairwise(self.rows), strict=True):
            reached = _relax(links, to[before], here.stop - here.start, greatest=greatest, forward=True)
            to[here] = join(reached, value[here])
        after[self.rows[-1]] = 0.0
        for links, (here, behind) in zip(self.links[::-1], [*pairwise(self.rows)][::-1], strict=True):
            left = join(after[behind], value[behind])
            after[here] = _relax(links, left, here.stop - here.start, greatest=greatest, forward=False)
        return np.asarray(join(to, after))


class _ConsistentSearch:
    """Search for the best sequence in which points that are the same target have the same posture."""

    def __init__(self, first: IndexArray, *, greatest: bool) -> None:
        self._first, self._greatest = first, greatest
        self._trials = 0

    def find(self, trellis: Trellis, value: FloatArray, limit: float) -> IndexArray | None:
        """Return the best sequence (m,) whose total is less than a limit; None if none is found."""
        candidates, first = trellis.candidates, self._first
        found = trellis.find_best(value, greatest=self._greatest)
        if found is None or trellis.total(value, found, greatest=self._greatest) >= limit:
            return None
        joints = candidates.joints[found]
        differs = (joints != joints[first]).any(axis=1)
        if not differs.any():
            return found
        if self._trials >= MOST_TRIALS:
            return self.keep_first_postures(trellis, value, found, limit)
        target = first[np.argmax(differs)]
        visits = np.flatnonzero(first == target)
        here = np.flatnonzero(np.isin(candidates.point, visits))
        _, posture = np.unique(candidates.joints[here], axis=0, return_inverse=True)
        posture = posture.reshape(-1)
        through = trellis.least_through(value, greatest=self._greatest)[here]
        bound = np.zeros(posture.max() + 1)
        np.maximum.at(bound, posture, through)
        bound[np.bincount(posture) < len(visits)] = np.inf  # a visit does not reach this posture
        best: IndexArray | None = None
        for k in np.argsort(bound, kind="stable").tolist():
            if not bound[k] < limit or self._trials >= MOST_TRIALS:
                break
            self._trials += 1
            kept = np.ones(len(value), dtype=np.bool_)
            kept[here] = posture == k
            part = trellis.restrict(kept)
            again = self.find(part, value[kept], limit)
            if again is not None:
                best = np.flatnonzero(kept)[again]
                limit = part.total(value[kept], again, greatest=self._greatest)
        return best

    def keep_first_postures(
        self, trellis: Trellis, value: FloatArray, found: IndexArray, limit: float
    ) -> IndexArray | None:
        """Return the best sequence (m,) with the postures that another (m,) has at first visits."""
        candidates, first = trellis.candidates, self._first
        is_repeated = (np.bincount(first, minlength=len(first))[first] > 1)[candidates.point]
        wanted = candidates.joints[found[first[candidates.point]]]
        kept = ~is_repeated | (candidates.joints == wanted).all(axis=1)
        part = trellis.restrict(kept)
        again = part.find_best(value[kept], greatest=self._greatest)
        if again is None or part.total(value[kept], again, greatest=self._greatest) >= limit:
            return None
        return np.flatnonzero(kept)[again]


def _relax(
    links: Links | None, total: FloatArray, count: int, *, greatest: bool, forward: bool
) -> FloatArray:
    """Return the least total (count,) with which motions lead to candidates, or from them if backward."""
    if links is None:
        return np.full(count, total.min(initial=np.inf))
    start, end = (links.first, links.last) if forward else (links.last, links.first)
    reached = np.full(count, np.inf)
    np.minimum.at(reached, end, total[start] if greatest else total[start] + links.cost)
    return reached


@dataclass(frozen=True, eq=False)
class _Pairs:
    """Pairs of a candidate of the point before and one of the point, counted from the first ones."""

    first: IndexArray  # (E,)
    last: IndexArray  # (E,)
    change: FloatArray  # (E,) turn from one to the other [rad]

    def select(self, kept: BoolArray) -> _Pairs:
        """Return those pairs only that a mask (E,) keeps."""
        return _Pairs(self.first[kept], self.last[kept], self.change[kept])


def _pair_by_turn(
    candidates: Candidates, angles: FloatArray, before: slice, here: slice, most: float, *, closed: bool
) -> _Pairs:
    """Return all pairs whose turns differ by at most `most` [rad], and between which no singularity lies.

    A given posture has the turn zero, and may be on any side of a singularity.
    """
    start_turns, end_turns = _turns(candidates, before, here)
    starts, ends = (np.where(each < 0, 0.0, angles[each]) for each in (start_turns, end_turns))
    any_side = (start_turns < 0).any() or (end_turns < 0).any()
    apart = 0.0 if any_side else _APART
    # With turns of different sides far apart, a search by turn finds those of the same side alone.
    start_shift, end_shift = (apart * candidates.side[part] for part in (before, here))
    order = np.argsort(ends + end_shift, kind="stable")
    sorted_ends = (ends + end_shift)[order]
    shifts = (0.0, 2.0 * np.pi, -2.0 * np.pi) if closed and most < np.pi else (0.0,)
    firsts, lasts, changes = [], [], []
    for shift in shifts:
        wanted = starts + shift
        low = np.searchsorted(sorted_ends, wanted + start_shift - most - _ROUNDING)
        high = np.searchsorted(sorted_ends, wanted + start_shift + most + _ROUNDING, side="right")
        count = high - low
        first = np.repeat(np.arange(len(starts)), count)
        place = np.arange(len(first)) - np.repeat(np.cumsum(count) - count, count) + low[first]
        last = order[place]
        firsts.append(first)
        lasts.append(last)
        changes.append(ends[last] - wanted[first])
    pairs = _Pairs(np.concatenate(firsts), np.concatenate(lasts), np.concatenate(changes))
    if closed and len(shifts) == 1:
        wrapped = pairs.change - 2.0 * np.pi * np.round(pairs.change / (2.0 * np.pi))
        pairs = replace(pairs, change=wrapped)
    return pairs


def _turns(candidates: Candidates, before: slice, here: slice) -> tuple[IndexArray, IndexArray]:
    """Return the indices of the turns of the candidates of two points."""
    return candidates.turn[before], candidates.turn[here]


def _find_best_links(
    links: Links, total: FloatArray, count: int, *, greatest: bool
) -> tuple[FloatArray, IndexArray]:
    """Return the least total (count,) with which each candidate is reached, and the candidate before it."""
    cost = total[links.first] if greatest else total[links.first] + links.cost
    before, source = np.full(count, np.inf), np.zeros(count, dtype=np.intp)
    if not len(cost):
        return before, source
    starts = np.flatnonzero(np.diff(links.last, prepend=_NONE))
    reached = links.last[starts]
    before[reached] = np.minimum.reduceat(cost, starts)
    # The first link of the least cost: a link is the best one of its candidate if its cost is the minimum.
    is_best = np.flatnonzero(cost == before[links.last])
    source[links.last[is_best[::-1]]] = links.first[is_best[::-1]]
    return before, source


def _refuse_gap(candidates: Candidates, before: slice, here: slice, sources: IndexArray, point: int) -> None:
    """Raise a `RequestError` that names the motion that would be needed between two points."""
    distance, _ = KDTree(candidates.angles[before][sources]).query(candidates.angles[here], p=np.inf)
    least = float(np.degrees(np.min(distance)))
    reason = "each motion crosses a singularity, or turns the tool faster than `rate`"
    if least > np.degrees(_LARGEST):
        reason = f"a joint moves by at least {least:.3g}°"
    raise RequestError(
        f"between the points {point} and {point + 1} of the path {reason}",
        where="path",
        remedy="add points between the two, raise `rate`, or move the workpiece",
    )
