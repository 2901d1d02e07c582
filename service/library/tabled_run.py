"""Runs in a notebook: in process, and as a table."""

from __future__ import annotations

from collections.abc import Mapping
from io import StringIO
from os import PathLike
from pathlib import Path
from typing import Any

from rich.console import Console

from jointstiff.schemas.campaign import Campaign
from jointstiff.schemas.run.options import RunOptions
from jointstiff.schemas.run.run import Run
from jointstiff.service.kinds.report import job_report
from jointstiff.service.kinds.run import RUN
from jointstiff.service.library import campaigns

AnyCampaign = Campaign | Mapping[str, Any] | str | PathLike[str]
"""A campaign, its document, or the name of its file."""

_WIDTH = 100


class TabledRun(Run):
    """A run that shows itself as a table where it is displayed, as in a notebook."""

    def _repr_html_(self) -> str:
        """Return the report of the terminal as HTML."""
        console = Console(record=True, file=StringIO(), width=_WIDTH)
        console.print(job_report(RUN, self))
        return console.export_html(
            inline_styles=True, code_format='<pre style="line-height:1.2">{code}</pre>'
        )


def campaign_of(campaign: AnyCampaign) -> Campaign:
    """Return a campaign from a file, or from a document that was read already.

    Raises:
        CampaignError: the file is too large, or the document is no campaign.
        OSError: the file cannot be read.
    """
    if isinstance(campaign, Campaign):
        return campaign
    if isinstance(campaign, Mapping):
        return campaigns.parse_document(dict(campaign), Campaign)
    return campaigns.read_campaign(Path(campaign))


def identify(
    campaign: AnyCampaign,
    **options: Any,  # noqa: ANN401 - fields of RunOptions
) -> TabledRun:
    """Identify the joint stiffnesses from a campaign, in this process.

    Args:
        campaign: a file, a document that was read from JSON, or a `Campaign`.
        options: fields of `RunOptions` that replace the campaign's, such as `method="complete_pose"`.

    Returns:
        The run, with its result in SI units. A failure of the identification is a run in state `failed`.

    Raises:
        CampaignError: campaign or options cannot be used; its `problem` says what, where and what to do.
        OSError: the file cannot be read.
    """
    read = campaign_of(campaign)
    asked = campaigns.parse_document(
        read.run.model_dump(mode="json", exclude_unset=True) | options, RunOptions
    )
    return TabledRun.model_validate(dict(campaigns.identify(read, asked)))
