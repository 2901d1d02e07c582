"""The verb of comparisons."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Literal, TypedDict, Unpack

from jointstiff.schemas.comparison import CampaignComparison
from jointstiff.schemas.run import Run
from jointstiff.service.kinds.comparison.kind import COMPARISON
from jointstiff.service.kinds.verb import Backend, JobMonitor, describe_fields, merge_options
from jointstiff.service.resources.documents import parse_document

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from concurrent.futures import Executor

    from jointstiff.schemas.comparison import ComparedMethod, Comparison
    from jointstiff.schemas.options import Resampling, RunOptions
    from jointstiff.service.conversion.arguments import AnyUnits
    from jointstiff.service.kinds.verb import Cancel, OnProgress, Source


class CompareFields(TypedDict, total=False):
    """Options of `compare`."""

    units: AnyUnits
    ordered: bool
    same_load_point: bool
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
        backend: `Here` or a `Client`, which has this function as a method and does the work.
        first: campaign or run, such as with the motors' encoders in the position loop, or before a repair.
        second: campaign or run to compare with the first, such as with secondary encoders in the position
            loop, or after a repair; without a second, methods are compared on the first.
        options: a `CampaignComparison`; keyword arguments replace options of the same name.
        on_progress: called with the progress of a job that takes steps; default: a bar in a terminal or a
            notebook, if it takes more than 2 s.
        cancel: called between steps, such as `threading.Event().is_set`; if true, the job ends as
            `cancelled`.
        executor: carries out the steps, such as a `concurrent.futures.ProcessPoolExecutor()` or a Dask
            client's `get_executor()`; all numbers are the same to the last bit. A `Client` refuses an
            executor.
        fields: fields of `CampaignComparison`.

    Returns:
        The Comparison, with its result in SI units. If the computation fails, its state is `failed`.

    Raises:
        CampaignError: a source or an option cannot be used; the error's `problem` has reason and remedy.
        RefusedError: the service refuses the request.
        OSError: a file cannot be read.
    """
    from jointstiff.service.kinds.comparison.work import ComparedSet, request_comparison

    with JobMonitor(on_progress, cancel, executor) as monitor:
        backend = backend.start_call(monitor)
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
        return backend.carry_out_request(
            COMPARISON, request.model_dump(mode="json", exclude_unset=True), {}, monitor
        )


describe_fields(compare, CampaignComparison)
