"""Identified models as files and reports, without a server."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from jointstiff.schemas.campaign import Campaign
from jointstiff.schemas.job import Job
from jointstiff.service.exporting.formats import ModelFormat, export_model
from jointstiff.service.exporting.model import ExportedModel
from jointstiff.service.inputs.files import FromFile
from jointstiff.service.kinds.kind import AnyKind
from jointstiff.service.kinds.registry import KINDS
from jointstiff.service.library.campaigns import (
    add_model,
    as_campaign_error,
    read_document,
)
from jointstiff.service.library.errors import CampaignError
from jointstiff.service.reports.document import Document, draft
from jointstiff.service.reports.job import job_document
from jointstiff.service.reports.laboratory import LaboratorySettings
from jointstiff.service.reports.rendering import report_page, report_pdf
from jointstiff.service.reports.run import RunSubject, run_document

if TYPE_CHECKING:
    from jointstiff.schemas.run.run import Run


def exported(
    campaign: Campaign, name: ModelFormat, run: Run | None = None, accept_verdict: str | None = None
) -> bytes:
    """Return the model of a campaign as a file.

    Args:
        campaign: robot and readings.
        name: of the format.
        run: of that campaign; identified now, as the campaign says, if None.
        accept_verdict: `do_not_use` to export a run with that verdict.

    Raises:
        CampaignError: robot, readings or run cannot be used.
    """
    model = _model(campaign, run)
    with as_campaign_error("export"):
        return export_model(model, name, accept_verdict)


def reported(path: Path, as_pdf: bool, settings: LaboratorySettings, run: Run | None = None) -> bytes:
    """Return the report on a file: on a campaign, or on another job.

    Args:
        path: a campaign, or a comparison, pair, plan, map or program as its command prints it with `--json`.
        as_pdf: PDF, or HTML.
        settings: of the laboratory.
        run: of the campaign; identified now, as the campaign says, if None.

    Raises:
        CampaignError: the file, the run or the settings cannot be used, or Typst is not installed.
    """
    try:
        campaign = read_document(path, Campaign)
    except CampaignError as error:
        found = None if run is not None else _job(path)
        if found is None:
            raise error from None
        kind, job = found
        document = job_document(kind, job, job.model_dump_json(), settings)
    else:
        return reported_run(campaign, as_pdf, settings, run)
    return _written(document, as_pdf)


def reported_run(campaign: Campaign, as_pdf: bool, settings: LaboratorySettings, run: Run | None) -> bytes:
    """Return the report on a campaign, which is a draft; arguments and errors as of `reported`."""
    subject = RunSubject(_model(campaign, run), campaign.measurement_set, settings)
    return _written(run_document(subject, draft()), as_pdf)


def _written(document: Document, as_pdf: bool) -> bytes:
    with as_campaign_error("report"):
        return report_pdf(document) if as_pdf else report_page(document)


def _job(path: Path) -> tuple[AnyKind, Job] | None:
    """Return the job with a result that a file holds, and its kind; None if it holds none."""
    for kind in KINDS:
        if kind.reported:
            try:
                job: Job = read_document(path, kind.message)
            except CampaignError:
                continue
            if job.result is not None:
                return kind, job
    return None


def _model(campaign: Campaign, run: Run | None) -> ExportedModel:
    inputs = FromFile()
    found = inputs.run(add_model(inputs, campaign, run), "run_id")
    with as_campaign_error("run"):
        return ExportedModel.of(found.run, found.prepared.robot, campaign.robot.name)
