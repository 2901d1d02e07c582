"""Identified models as files and reports, without a server."""

from __future__ import annotations

from typing import TYPE_CHECKING

from jointstiff.service.exporting import ExportedModel, ModelFormat, export_model
from jointstiff.service.library.campaigns import as_campaign_error, model_run, prepared_campaign
from jointstiff.service.reports import (
    LaboratorySettings,
    RunSubject,
    draft,
    report_page,
    report_pdf,
    run_document,
)

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
    model = _model(campaign, run)
    with as_campaign_error("export"):
        return export_model(model, name)


def reported(campaign: Campaign, as_pdf: bool, settings: LaboratorySettings, run: Run | None = None) -> bytes:
    """Return the report on a campaign, which is a draft.

    Args:
        campaign: robot and readings.
        as_pdf: PDF, or HTML.
        settings: of the laboratory.
        run: of that campaign; identified now, as the campaign says, if None.

    Raises:
        CampaignError: robot, readings or run cannot be used, or Typst is not installed.
    """
    subject = RunSubject(_model(campaign, run), campaign.measurement_set, settings)
    document = run_document(subject, draft())
    with as_campaign_error("report"):
        return report_pdf(document) if as_pdf else report_page(document)


def _model(campaign: Campaign, run: Run | None) -> ExportedModel:
    run = model_run(campaign, run)
    robot = prepared_campaign(campaign).robot
    with as_campaign_error("run"):
        return ExportedModel.of(run, robot, campaign.robot.name)
