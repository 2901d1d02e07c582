"""The verb of runs."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Literal, TypedDict, Unpack

from jointstiff.schemas.options import RunOptions
from jointstiff.service.kinds.run.kind import RUN
from jointstiff.service.kinds.verb import (
    Backend,
    JobMonitor,
    Request,
    carry_out_verb,
    describe_verb,
    merge_options,
)

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from concurrent.futures import Executor

    from jointstiff.schemas.finding import NamedCause
    from jointstiff.schemas.options import CrossValidation, OwnWeight, Resampling, StiffnessPrior
    from jointstiff.schemas.run import Run
    from jointstiff.service.conversion.units import AnyUnits
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
        campaign: a file, a document that was read from JSON, a `Campaign`, or a run.
    """

    def make_request(backend: Backend) -> Request:
        """Return the set to identify, with the options."""
        return Request(make_run_request(backend, campaign, options, fields))

    return carry_out_verb(backend, RUN, JobMonitor(on_progress, cancel, executor), make_request)


def make_run_request(
    backend: Backend, campaign: Source, options: RunOptions | None, fields: Mapping[str, Any]
) -> dict[str, Any]:
    """Prepare a campaign; return the request that identifies it.

    The campaign's own options apply, unless the caller gives `options`; but observations that the campaign
    leaves out are left out in any case. `fields` replace options of the same name.

    Raises:
        CampaignError: the campaign or an option cannot be used.
    """
    set_id, campaign_options = backend.prepare_set(campaign)
    request: dict[str, Any] = {"measurement_set_id": set_id}
    if campaign_options is not None:
        defaults = campaign_options.model_dump(mode="json", exclude_unset=True) if options is None else {}
        request = defaults | request | {"leave_out": campaign_options.leave_out}
    return request | merge_options(RunOptions, options, fields)


describe_verb(identify, RUN)
