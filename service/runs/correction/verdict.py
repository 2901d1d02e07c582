"""Worth of a correction: reasons and remedies of the statuses of its rows, and its assessment."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from types import MappingProxyType
from typing import Final, get_args

import numpy as np

from jointstiff.schemas.correction import CorrectionStatus
from jointstiff.schemas.finding import Finding
from jointstiff.service.runs.verdicts import (
    PriorModel,
    RunModel,
    find_beyond_campaign,
    find_far_points,
    find_implausible_deflection,
    find_missing_numbers,
    make_reason,
)
from jointstiff.solver.correct.blend import describe_blend
from jointstiff.solver.correct.correct import CorrectedRows, RowStatus
from jointstiff.solver.predict.models import EXTRAPOLATED

NAMES: Final[tuple[CorrectionStatus, ...]] = get_args(CorrectionStatus)
"""Names of the statuses, in the order of `RowStatus`."""
REASONS: Final[Mapping[CorrectionStatus, tuple[str, str]]] = MappingProxyType(
    {
        "capped": ("the limits reduce the correction", "check the load, then raise the limits"),
        "uncertain": ("the deflection is less than its uncertainty", "measure more if it matters"),
        "beyond_limits": ("a joint would leave its limits", "move the part"),
        "not_reached": ("the robot does not reach the pose", "check tool, base and units"),
        "ambiguous": (
            "the posture is not certain from here on",
            "give joints (`J1 [deg]` …), or `start`: the joints near the first pose",
        ),
        "contradictory": ("pose and joints differ", "correct the pose or the joints"),
        "unseen_joint": (
            "the load twists a joint that the readings do not determine",
            "choose a run that determines this joint",
        ),
        "overloaded": ("the load is too great for the model", "check the units of force and length"),
        "no_direction": ("the tool does not move, so the load has no direction", "state other `axes`"),
    }
)
"""Status → reason and remedy, for statuses of rows that are not corrected in full."""
WITHOUT_NUMBERS: Final = frozenset(
    {
        *("beyond_limits", "not_reached", "ambiguous", "contradictory"),
        *("unseen_joint", "overloaded", "no_direction"),
    }
)
"""Statuses of rows that have no numbers."""


def count_statuses(rows: CorrectedRows) -> dict[CorrectionStatus, int]:
    """Return the number of rows by status, in order of the statuses; only statuses that occur."""
    counts = np.bincount(rows.status, minlength=len(RowStatus)).tolist()
    return {NAMES[each]: counts[each] for each in RowStatus if counts[each]}


def find_first_rows(rows: CorrectedRows) -> dict[CorrectionStatus, int]:
    """Return the first row, from 1, of each status that occurs."""
    statuses, first = np.unique(rows.status, return_index=True)
    return {NAMES[status]: row + 1 for status, row in zip(statuses.tolist(), first.tolist(), strict=True)}


def describe_rows(rows: CorrectedRows) -> list[str]:
    """Return a line for each status of rows that are not corrected in full: count, reason, remedy."""
    first, lines = find_first_rows(rows), list[str]()
    for name, count in count_statuses(rows).items():
        if name in REASONS:
            reason, remedy = REASONS[name]
            lines.append(f"{count} of {len(rows)} rows, first row {first[name]}: {reason}; {remedy}")
    is_blended = np.isfinite(rows.blend_length)
    if is_blended.any():
        text = describe_blend(rows.blend_length[is_blended].max(), rows.residual[is_blended].max())
        number = 1 + int(np.argmax(is_blended))
        lines.append(f"{int(is_blended.sum())} of {len(rows)} rows, first row {number}: {text}")
    return lines


def find_reasons(
    rows: CorrectedRows, points: Sequence[Sequence[float]], model: RunModel | PriorModel
) -> list[Finding]:
    """Return reasons to doubt a correction, in addition to those of its run.

    `points` are places in the flange frame [m], such as the load point, that must be near the flange.
    """
    has_numbers = rows.has_numbers
    count, missing = len(rows), int((~has_numbers).sum())
    lengths = np.linalg.norm(rows.deflection[has_numbers], axis=1)
    extrapolated = int((rows.extrapolation[has_numbers] > EXTRAPOLATED).sum())
    has_unseen_joint = bool((rows.status == RowStatus.UNSEEN_JOINT).any())
    remedy = _choose_remedy(rows)
    return [
        *find_missing_numbers(missing, count, "rows", unseen=has_unseen_joint, remedy=remedy),
        *find_implausible_deflection(float(lengths.max(initial=0.0)), model.result),
        *find_far_points(points),
        *find_beyond_campaign(extrapolated, count, "rows"),
        *_find_capped(rows),
        *_find_nothing_corrected(rows),
    ]


def _find_capped(rows: CorrectedRows) -> Iterator[Finding]:
    """Yield a reason if corrections were larger than allowed, and were shortened."""
    capped = int((rows.status == RowStatus.CAPPED).sum())
    if capped:
        reason, remedy = REASONS["capped"]
        message = f"{reason} in {capped} of {len(rows)} rows"
        yield make_reason("corrections_capped", "use_with_care", message, remedy)


def _find_nothing_corrected(rows: CorrectedRows) -> Iterator[Finding]:
    """Yield a reason if no row is corrected, not even by a shortened correction.

    Without any number, the reason on missing numbers says the same.
    """
    is_corrected = (rows.status == RowStatus.CORRECTED) | (rows.status == RowStatus.CAPPED)
    if rows.has_numbers.any() and not is_corrected.any():
        remedy = _choose_remedy(rows) or "read the status of the rows"
        yield make_reason("nothing_corrected", "use_with_care", "no row is corrected", remedy)


def _choose_remedy(rows: CorrectedRows) -> str | None:
    """Return the remedy of the most frequent status without numbers; None if all rows have numbers."""
    counts = count_statuses(rows)
    frequent = sorted(set(counts) & WITHOUT_NUMBERS, key=lambda name: (-counts[name], name))
    return REASONS[frequent[0]][1] if frequent else None
