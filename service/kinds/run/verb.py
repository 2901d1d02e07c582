"""The verb of runs."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Literal, TypedDict, Unpack

from jointstiff.schemas.options import RunOptions
from jointstiff.service.kinds.run.kind import RUN
from jointstiff.service.kinds.verb import Backend, JobMonitor, describe_fields, merge_options

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from concurrent.futures import Executor

    from jointstiff.schemas.finding import NamedCause
    from jointstiff.schemas.options import CrossValidation, OwnWeight, Resampling, StiffnessPrior
    from jointstiff.schemas.run import Run
    from jointstiff.service.conversion.arguments import AnyUnits
    from jointstiff.service.kinds.verb import Cancel, OnProgress, Source


class IdentifyFields(TypedDict, total=False):
    """Options of `identify`."""

    units: AnyUnits
    method: Literal["complete_pose", "partial_pose", "decoupled_partial_pose", "CP", "PP", "DPP"]
    weighting: Literal["covariance", "characteristic_length", "uniform"]
    characteristic_length: float | None
    positive: bool
    stiffness_bounds: Mapping[str, Sequence[float | None]]
    loss: Literal["squared", "huber", "automatic"]
    huber_threshold: float | None
    complementary_stiffness: Literal["neglected", "included"]
    causes: Sequence[NamedCause | Mapping[str, Any]]
    priors: Mapping[str, StiffnessPrior | Mapping[str, Any]]
    stiffness_order: Sequence[Sequence[str]]
    elasticity: Literal[
        "joints",
        "joints_and_base",
        "coupled_joints",
        "diagonal_links",
        "joints_and_links",
        "links_and_base",
        "automatic",
    ]
    links: Sequence[str]
    link_penalty: float | None
    cross_validation: CrossValidation | Mapping[str, Any]
    resampling: Resampling | Mapping[str, Any] | None
    confidence: float
    weight: OwnWeight | Mapping[str, Any] | None
    leave_out: Sequence[str]


def identify(
    backend: Backend,
    campaign: Source,
    /,
    options: RunOptions | None = None,
    *,
    on_progress: OnProgress | None = None,
    cancel: Cancel | None = None,
    executor: Executor | None = None,
    **fields: Unpack[IdentifyFields],
) -> Run:
    """Identify the joint stiffnesses of a campaign.

    Args:
        backend: `Here` or a `Client`, which has this function as a method and does the work.
        campaign: a file, a document that was read from JSON, a `Campaign`, or a run.
        options: a `RunOptions`; keyword arguments replace options of the same name.
        on_progress: called with the progress of a job that takes steps; default: a bar in a terminal or a
            notebook, if it takes more than 2 s.
        cancel: called between steps, such as `threading.Event().is_set`; if true, the job ends as
            `cancelled`.
        executor: carries out the steps, such as a `concurrent.futures.ProcessPoolExecutor()` or a Dask
            client's `get_executor()`; all numbers are the same to the last bit. A `Client` refuses an
            executor.
        fields: fields of `RunOptions`.

    Returns:
        The Run, with its result in SI units. If the computation fails, its state is `failed`.

    Raises:
        CampaignError: a source or an option cannot be used; the error's `problem` has reason and remedy.
        RefusedError: the service refuses the request.
        OSError: a file cannot be read.
    """
    with JobMonitor(on_progress, cancel, executor) as monitor:
        backend = backend.start_call(monitor)
        set_id, campaign_options = backend.prepare_set(campaign)
        request: dict[str, Any] = {"measurement_set_id": set_id}
        if campaign_options is not None:
            # The campaign's own options apply, unless the caller gives `options`; but observations that the
            # campaign leaves out are left out in any case.
            defaults = campaign_options.model_dump(mode="json", exclude_unset=True) if options is None else {}
            request = defaults | request | {"leave_out": campaign_options.leave_out}
        return backend.carry_out_request(
            RUN, request | merge_options(RunOptions, options, fields), {}, monitor
        )


describe_fields(identify, RunOptions)
