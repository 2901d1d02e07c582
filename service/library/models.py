"""Identified models as files for other programs, without a server."""

from __future__ import annotations

from typing import TYPE_CHECKING

from jointstiff.service.exporting import ExportedModel, ModelFormat, export_model
from jointstiff.service.library.campaigns import as_campaign_error, model_run, prepared_campaign

if TYPE_CHECKING:
    from jointstiff.schemas.campaign import Campaign
    from jointstiff.schemas.run import Run


def exported(campaign: Campaign, name: ModelFormat, run: Run | None = None) -> bytes:
    """Return the model of a campaign as a file.

    Args:
        campaign: robot and readings.
        name: of the format.
        run: of that campaign; identified now, as the campaign says, if None.

    Raises:
        CampaignError: robot, readings or run cannot be used.
    """
    run = model_run(campaign, run)
    robot = prepared_campaign(campaign).robot
    with as_campaign_error("export"):
        return export_model(ExportedModel.of(run, robot, campaign.robot.name), name)
