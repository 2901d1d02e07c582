"""The command `report`: a campaign's result as a document to sign."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from jointstiff.service.cli.answers import failed, refuse_existing, refused, write_bytes
from jointstiff.service.cli.options import LaboratoryFile, Overwrite, RunFile

_SUFFIXES = (".pdf", ".html")


def report(
    file: Annotated[
        Path,
        typer.Argument(
            exists=True,
            dir_okay=False,
            metavar="FILE",
            help="Campaign; or comparison, pair, plan, map or program, as its command prints it with --json.",
        ),
    ],
    *,
    output: Annotated[
        Path, typer.Option("--output", "-o", metavar="FILE", help="Write it there: .pdf or .html.")
    ],
    run: RunFile = None,
    laboratory: LaboratoryFile = None,
    overwrite: Overwrite = False,
) -> None:
    """Write a report: results, uncertainty, method, traceability. That on a campaign is a draft."""
    from jointstiff.schemas.run.run import Run
    from jointstiff.service.library import models
    from jointstiff.service.library.campaigns import read_document
    from jointstiff.service.library.errors import CampaignError
    from jointstiff.service.reports.laboratory import LaboratorySettings, SettingsError, read_laboratory

    if output.suffix.lower() not in _SUFFIXES:
        raise typer.BadParameter(f"ends in {' or '.join(_SUFFIXES)}", param_hint="--output")
    refuse_existing(output, overwrite=overwrite)
    try:
        settings = LaboratorySettings() if laboratory is None else read_laboratory(laboratory)
        measured = None if run is None else read_document(run, Run)
        content = models.reported(file, output.suffix.lower() == ".pdf", settings, measured)
    except CampaignError as error:
        raise refused(error.problem) from error
    except SettingsError as error:
        raise failed(error.reason, error.remedy) from error
    write_bytes(output, content)
    typer.echo(f"{output}: {len(content):,} bytes")
