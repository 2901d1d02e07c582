"""The verb of comparisons."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Literal, TypedDict, Unpack

from jointstiff.schemas.comparison import CampaignComparison
from jointstiff.schemas.options import RunOptions
from jointstiff.schemas.run import Run
from jointstiff.service.kinds.comparison.kind import COMPARISON
from jointstiff.service.kinds.verb import (
    Backend,
    JobMonitor,
    Request,
    carry_out_verb,
    describe_verb,
    merge_options,
)
from jointstiff.service.resources.documents import parse_document

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from concurrent.futures import Executor

    from jointstiff.schemas.comparison import ComparedMethod, Comparison
    from jointstiff.schemas.options import Resampling
    from jointstiff.service.conversion.units import AnyUnits
    from jointstiff.service.kinds.verb import Cancel, OnProgress, Source


class CompareFields(TypedDict, total=False):
    """Options of `compare`."""

    units: AnyUnits
    ordered: bool
    same_load: bool
    same_cell: bool
    confidence: float | None
    methods: Sequence[ComparedMethod | Mapping[str, Any]]
    constraints: Sequence[Literal["unconstrained", "positive"]]
    resampling: Resampling | Mapping[str, Any] | None
    run: RunOptions | Mapping[str, Any] | None


def compare(
    backend: Backend,
    first: Source,
    second: Source | None = None,
    /,
    options: CampaignComparison | None = None,
    *,
    on_progress: OnProgress | None = None,
    cancel: Cancel | None = None,
    executor: Executor | None = None,
    **fields: Unpack[CompareFields],
) -> Comparison:
    """Compare methods on a campaign, or two campaigns of one robot.

    Args:
        first: campaign or run, such as with the motors' encoders in the position loop, or before a repair.
        second: campaign or run to compare with the first, such as with secondary encoders in the position
            loop, or after a repair; without a second, methods are compared on the first.
    """
    from jointstiff.service.kinds.comparison.work import ComparedSet, request_comparison

    def make_request(backend: Backend) -> Request:
        """Identify what is compared, and return its runs with the options."""
        chosen = parse_document(merge_options(CampaignComparison, options, fields), CampaignComparison)
        sources = [first] if second is None else [first, second]
        sets: list[ComparedSet] = []
        for source, error_prefix in zip(sources, ("first.", "second."), strict=False):
            set_id, source_options = backend.prepare_set(source, error_prefix if len(sources) > 1 else "")
            source_options = source_options or RunOptions()
            # A second campaign is identified with the options of the first campaign; a run keeps its options.
            keeps_options = isinstance(source, Run) or not sets
            run_options = source_options if keeps_options else sets[0].options
            sets.append(ComparedSet(set_id, source_options.leave_out, chosen.run or run_options))
        request = request_comparison(
            sets, chosen, lambda run, dispensable: backend.run(run, monitor, dispensable)
        )
        return Request(request.model_dump(mode="json", exclude_unset=True))

    monitor = JobMonitor(on_progress, cancel, executor)
    return carry_out_verb(backend, COMPARISON, monitor, make_request)


describe_verb(compare, COMPARISON)
