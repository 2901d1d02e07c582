"""Positions of the targets on the flange: constant if angles and readings belong together.

A robot stands where its model says within millimetres. A mistake in the angles, their order, a name or a
unit moves a target by centimetres or metres as seen from the flange; and the mistake that was made is the
one whose correction brings the targets back to one place.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np

from jointstiff.solver.arrays import BoolArray, FloatArray, IndexArray
from jointstiff.solver.finding import Finding, length_text
from jointstiff.solver.integrity.hypotheses import Hypothesis, angle_hypotheses, unit_hypotheses
from jointstiff.solver.integrity.view import View, median, seen_from_flange
from jointstiff.solver.robot.configuration import Configurations

LARGEST_MODEL_ERROR: Final = 0.02
"""Largest plausible deviation from the model's position [m]: more is a wrong frame, map, unit or angle."""
OUTLIER: Final = 10.0
"""Factor on the median distance from the median position: model errors vary with the posture, but less."""
SMALLEST_OUTLIER: Final = 2e-3
"""Distance [m] below which nothing is reported: a joint by 0.05° at 2 m."""
EXPLAINED: Final = 0.8
"""Share of the rows that a mistake of the whole set must explain; others may have their own."""
_ANCHORS: Final = 24
_ROWS: Final = 150
"""Number of rows that suffice to find a mistake of the whole set."""
_SEARCHED: Final = 300
"""Maximum number of rows for which the matching posture is searched."""


@dataclass(frozen=True, eq=False)
class Places:
    """Findings from the positions of the targets on the flange."""

    findings: tuple[Finding, ...]  #: suspicious places
    good: BoolArray  #: (N,) rows whose targets sit where they should, or that measured no place
    sound: bool  #: whether the set as a whole may be looked at further


@dataclass(frozen=True, eq=False)
class _Consensus:
    """The place (T, 3) of the targets on which most rows agree, and which do (M,)."""

    place: FloatArray
    agree: BoolArray
    apart: FloatArray

    @property
    def count(self) -> int:
        return int(self.agree.sum())


def inspect_places(view: View) -> Places:
    """Compare where each observation sees the targets on the flange."""
    useful = view.measured & (view.measured.sum(axis=0) > 1)
    rows = np.flatnonzero(useful.any(axis=1))
    good = np.ones(len(useful), dtype=np.bool_)
    if len(rows) < 2:
        return Places((), good, sound=True)
    seen = np.where(useful[..., None], view.places, np.nan)[rows]
    place = _median(seen)
    apart = _apart(seen, place)
    if apart.max() <= LARGEST_MODEL_ERROR:
        findings = [*_outliers(rows, seen - place), *_loaded_under_other_names(view, rows, place)]
        return Places(tuple(findings), good, sound=True)
    # Some targets are far from where the others say: find the mistake that explains it.
    as_posted = _consensus(seen)
    sample = rows[np.unique(np.linspace(0, len(rows) - 1, _ROWS).round().astype(int))]
    hypotheses = [*unit_hypotheses(view.measurements.joints[sample])]
    hypotheses += angle_hypotheses(view.measurements.joints, sample, view.robot.joint_names)
    judged = [(h, _consensus(_places_under(view, sample, h))) for h in hypotheses]
    best, places = max(judged, key=lambda pair: (pair[1].count, -median(pair[1].apart)))
    posted_share = as_posted.count / len(rows)
    if places.count >= EXPLAINED * len(sample) and places.count / len(sample) > posted_share + 0.1:
        mistake = Finding(
            best.code,
            None,
            f"as posted, the targets keep one position on the flange in {as_posted.count} of {len(rows)} "
            f"observations; with {best.figure}, in {places.count} of {len(places.agree)}, within "
            f"{length_text(float(places.apart[places.agree].max()))}",
            best.remedy,
            "error",
        )
        return Places((mistake,), np.zeros(len(view.measured), bool), sound=False)
    if best.code == "observations_out_of_order" and places.count / len(sample) > posted_share:
        as_posted = _against(seen, places.place)
    return _row_by_row(view, rows, seen, as_posted)


def _row_by_row(view: View, rows: IndexArray, seen: FloatArray, consensus: _Consensus) -> Places:
    """The rows that disagree one by one: names exchanged, or the readings of another posture."""
    bad = np.flatnonzero(~consensus.agree)
    good = np.ones(len(view.measured), dtype=np.bool_)
    good[rows[bad]] = False
    findings: list[Finding] = []
    elsewhere: dict[int, int] = {}
    for b in bad.tolist():
        i = int(rows[b])
        swapped = _swapped(seen[b], consensus.place)
        if swapped is not None:
            findings.append(_exchanged(view, i, swapped))
        elif len(elsewhere) < _SEARCHED and (j := _posture_of(view, i, consensus.place)) is not None:
            elsewhere[i] = j
        else:
            apart = np.nan_to_num(np.linalg.norm(seen[b] - consensus.place, axis=1))
            t = int(apart.argmax())
            findings.append(
                Finding(
                    "target_off_model",
                    i,
                    f"target '{view.targets[t]}' is {length_text(apart[t])} away from its median position on "
                    "the flange",
                    "check that positions are in R0 and in `units.length`, the angles and their order, the "
                    "joint map, and the robot's model",
                    "error",
                )
            )
    findings += _out_of_order(elsewhere)
    return Places(tuple(findings), good, sound=consensus.count >= max(2, len(rows) // 2))


def _out_of_order(elsewhere: dict[int, int]) -> Iterator[Finding]:
    """Shifted rows in one finding, others one by one."""
    for shift, neighbour in ((-1, "before"), (1, "after")):
        moved = [i for i, j in elsewhere.items() if j == i + shift]
        if len(moved) < 2 or any(elsewhere.get(elsewhere[i]) == i for i in moved):
            continue
        yield Finding(
            "observations_out_of_order",
            moved[0],
            f"the readings of {len(moved)} observations, observations[{moved[0]}] to [{moved[-1]}], were "
            f"taken at the angles of the row {neighbour}",
            f"shift the readings of these rows by one: each belongs to the angles of the row {neighbour}",
            "error",
        )
        for i in moved:
            del elsewhere[i]
    for i, j in elsewhere.items():
        yield Finding(
            "observations_out_of_order",
            i,
            f"its readings match the angles of observations[{j}]",
            "match readings and angles again; check the order of both",
            "error",
        )


def _exchanged(view: View, i: int, order: IndexArray) -> Finding:
    wrong = [t for t in np.flatnonzero(view.measured[i]).tolist() if order[t] != t]
    pairs = ", ".join(f"'{view.targets[t]}' is '{view.targets[order[t]]}'" for t in wrong)
    return Finding(
        "targets_swapped",
        i,
        f"the targets are at each other's positions on the flange: the target named {pairs}",
        "exchange their names in this observation",
        "error",
    )


def _loaded_under_other_names(view: View, rows: IndexArray, place: FloatArray) -> Iterator[Finding]:
    """Unloaded readings are right, and loaded ones sit where other targets do."""
    length = np.linalg.norm(view.measurements.deflection[rows], axis=2)
    far = rows[(length > LARGEST_MODEL_ERROR).any(axis=1)]
    for i in far.tolist():
        turned = view.measurements.deflection[i] @ view.configurations.flange_rotation[i]
        order = _swapped(view.places[i] + turned, place)
        if order is not None:
            yield _exchanged(view, i, order)


def _outliers(rows: IndexArray, apart: FloatArray) -> Iterator[Finding]:
    """A mistyped angle moves all targets at once, further than the model's errors do elsewhere."""
    with np.errstate(invalid="ignore"):
        nearest = np.fmin.reduce(np.linalg.norm(apart, axis=2), axis=1)
    limit = max(OUTLIER * median(nearest), SMALLEST_OUTLIER)
    for b in np.flatnonzero(nearest > limit):
        yield Finding(
            "target_off_model",
            int(rows[b]),
            f"all targets are at least {length_text(nearest[b])} away from their median positions on "
            f"the flange; typical is {length_text(median(nearest))}",
            "check the angles of this observation for a typing error, and whether the robot stood still",
        )


def _apart(seen: FloatArray, place: FloatArray) -> FloatArray:
    """(M,) greatest distance of a target from its place [m]."""
    distance = np.linalg.norm(seen - place, axis=2)
    apart: FloatArray = np.where(np.isnan(distance), 0.0, distance).max(axis=1)
    return apart


def _against(seen: FloatArray, place: FloatArray) -> _Consensus:
    apart = _apart(seen, place)
    return _Consensus(place, apart <= LARGEST_MODEL_ERROR, apart)


def _consensus(seen: FloatArray) -> _Consensus:
    """The place that most rows agree on: the median would be nowhere with half of the rows wrong."""
    anchors = seen[np.unique(np.linspace(0, len(seen) - 1, _ANCHORS).round().astype(int))]
    support = [_apart(seen, anchor) <= 2.0 * LARGEST_MODEL_ERROR for anchor in anchors]
    inliers = seen[max(support, key=lambda near: int(near.sum()))]
    return _against(seen, _median(inliers))


def _median(seen: FloatArray) -> FloatArray:
    """(T, 3) median place of each target; nan where it was not measured."""
    read = ~np.isnan(seen[..., 0])
    if read.all():
        whole: FloatArray = np.median(seen, axis=0)
        return whole
    place = np.full(seen.shape[1:], np.nan)
    for t in np.flatnonzero(read.any(axis=0)):
        place[t] = np.median(seen[read[:, t], t], axis=0)
    return place


def _places_under(view: View, rows: IndexArray, hypothesis: Hypothesis) -> FloatArray:
    """(M, T, 3) places on the flange, had that mistake been made [m]."""
    asked = rows[hypothesis.rows]
    q = view.robot.joint_map.model_angles(hypothesis.joints)
    position = hypothesis.length * view.measurements.position[asked]
    return seen_from_flange(Configurations(view.robot, q), position, view.measured[asked])


def _swapped(seen: FloatArray, place: FloatArray) -> IndexArray | None:
    """(T,) the target that each one really is; None if that explains nothing."""
    order = np.arange(len(place))
    read = np.flatnonzero(~np.isnan(seen[:, 0]))
    distance = np.linalg.norm(seen[read, None] - place, axis=2)
    distance = np.where(np.isnan(distance), np.inf, distance)
    order[read] = distance.argmin(axis=1)
    fits = distance.min(axis=1).max() <= LARGEST_MODEL_ERROR
    others = order[read]
    if not fits or len(set(others.tolist())) < len(others) or np.array_equal(others, read):
        return None
    return order


def _posture_of(view: View, i: int, place: FloatArray) -> int | None:
    """The row whose posture these readings were taken in, the nearest of several; None if there is none."""
    at = view.configurations
    expected = at.to_base(np.broadcast_to(np.nan_to_num(place), (len(at), *place.shape)))
    known = view.measured[i] & ~np.isnan(place[:, 0])
    if not known.any():
        return None
    apart = np.linalg.norm(expected[:, known] - view.measurements.position[i, known], axis=2).max(axis=1)
    fitting = np.flatnonzero(apart <= LARGEST_MODEL_ERROR)
    return int(fitting[np.abs(fitting - i).argmin()]) if len(fitting) else None
