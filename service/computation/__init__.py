"""Computation without a store: from messages by the numerical core to results."""

from __future__ import annotations

from jointstiff.service.computation.comparison import ComparisonWork
from jointstiff.service.computation.execution import (
    carry_out,
    final_state,
    new_job,
    outcome_of,
    unexpected_failure,
)
from jointstiff.service.computation.geometry import as_request_errors, geometry_work
from jointstiff.service.computation.pair import Side, pair_work
from jointstiff.service.computation.prepared import (
    PreparedRobot,
    PreparedSet,
    build_robot,
    check_set,
    prepare_robot,
    prepare_set,
)
from jointstiff.service.computation.run import run_work
from jointstiff.service.computation.work import QuickWork, Span, SteppedWork, Work, hash_of

__all__ = [
    "ComparisonWork",
    "PreparedRobot",
    "PreparedSet",
    "QuickWork",
    "Side",
    "Span",
    "SteppedWork",
    "Work",
    "as_request_errors",
    "build_robot",
    "carry_out",
    "check_set",
    "final_state",
    "geometry_work",
    "hash_of",
    "new_job",
    "outcome_of",
    "pair_work",
    "prepare_robot",
    "prepare_set",
    "run_work",
    "unexpected_failure",
]
