"""Computation without a store: from messages by the numerical core to results."""

from __future__ import annotations

from typing import TYPE_CHECKING

from jointstiff.solver.doors import names_of

if TYPE_CHECKING:
    from jointstiff.service.computation.comparison import ComparisonWork
    from jointstiff.service.computation.deflection import predict_by_run
    from jointstiff.service.computation.execution import (
        carry_out,
        final_state,
        new_job,
        outcome_of,
        unexpected_failure,
    )
    from jointstiff.service.computation.geometry import as_request_errors, geometry_work
    from jointstiff.service.computation.maps import MapWork
    from jointstiff.service.computation.pair import Side, pair_work
    from jointstiff.service.computation.plan import Planned, plan_work
    from jointstiff.service.computation.prepared import (
        PreparedRobot,
        PreparedSet,
        build_robot,
        check_set,
        prepare_robot,
        prepare_set,
    )
    from jointstiff.service.computation.program import ProgramWork, packed, unpacked, without_contents
    from jointstiff.service.computation.run import run_hash, run_work
    from jointstiff.service.computation.trend import Campaign, JointNumbers, TrendInput, trend_of
    from jointstiff.service.computation.work import QuickWork, Span, SteppedWork, Work, hash_of
else:
    __getattr__ = names_of(
        __name__,
        comparison="ComparisonWork",
        deflection="predict_by_run",
        execution="carry_out final_state new_job outcome_of unexpected_failure",
        geometry="as_request_errors geometry_work",
        maps="MapWork",
        pair="Side pair_work",
        plan="Planned plan_work",
        prepared="PreparedRobot PreparedSet build_robot check_set prepare_robot prepare_set",
        program="ProgramWork packed unpacked without_contents",
        run="run_hash run_work",
        trend="Campaign JointNumbers TrendInput trend_of",
        work="QuickWork Span SteppedWork Work hash_of",
    )

__all__ = [
    "Campaign",
    "ComparisonWork",
    "JointNumbers",
    "MapWork",
    "Planned",
    "PreparedRobot",
    "PreparedSet",
    "ProgramWork",
    "QuickWork",
    "Side",
    "Span",
    "SteppedWork",
    "TrendInput",
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
    "packed",
    "pair_work",
    "plan_work",
    "predict_by_run",
    "prepare_robot",
    "prepare_set",
    "run_hash",
    "run_work",
    "trend_of",
    "unexpected_failure",
    "unpacked",
    "without_contents",
]
