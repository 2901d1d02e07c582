"""Commands that use an identified model: `export`, and `report`, a document to sign."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final

import typer

from jointstiff.service.cli import options as cli
from jointstiff.service.settings import LaboratoryFile

if TYPE_CHECKING:
    from jointstiff.service.library.results import TabledRun

_FORMATS: Final = (".csv", ".xlsx", ".urdf", ".sdf", ".mjcf", ".xml")
_REPORTS: Final = (".pdf", ".html", ".xml")


def export(
    file: cli.CampaignFile,
    *,
    output: Annotated[
        Path, cli.output_option("File to write the model to: .csv, .xlsx, .urdf, .sdf, .mjcf or .xml (MJCF).")
    ],
    run: cli.RunFile = None,
    despite_verdict: Annotated[
        bool,
        typer.Option("--despite-verdict", help="Continue although the verdict on the run is: do not use."),
    ] = False,
    overwrite: cli.Overwrite = False,
) -> None:
    """Export a model as a table or for a simulator."""
    if output.suffix.lower() not in _FORMATS:
        raise typer.BadParameter(f"ends in one of {', '.join(_FORMATS)}", param_hint="--output")
    cli.refuse_existing(output, overwrite=overwrite)
    identified(file, run).export(output, "do_not_use" if despite_verdict else None)
    typer.echo(f"{output}: {output.stat().st_size:,} bytes")


def report(
    file: Annotated[
        Path,
        cli.file_argument(
            "FILE",
            "Campaign; or comparison, plan, map or program, as its command prints it with --json.",
        ),
    ],
    *,
    output: Annotated[
        Path,
        cli.output_option("File to write the report to: .pdf, .html, or .xml (certificate of a run, DCC)."),
    ],
    run: cli.RunFile = None,
    laboratory: LaboratoryFile = None,
    overwrite: cli.Overwrite = False,
) -> None:
    """Write a draft report on a campaign or a result."""
    from jointstiff.service.library.errors import CampaignError
    from jointstiff.service.library.here import read_job

    if output.suffix.lower() not in _REPORTS:
        raise typer.BadParameter(f"ends in one of {', '.join(_REPORTS)}", param_hint="--output")
    cli.refuse_existing(output, overwrite=overwrite)
    try:
        job: Any = identified(file, run)
    except CampaignError:  # the file may hold a job of another kind
        job = None if run is not None else read_job(file)
        if job is None:
            raise
    job.report(output, laboratory)
    typer.echo(f"{output}: {output.stat().st_size:,} bytes")


def identified(file: Path, run: Path | None) -> TabledRun:
    """Return the run of a campaign from its file; identified now without one."""
    from jointstiff.schemas.run import Run
    from jointstiff.service.library.files import campaign_of, read_document
    from jointstiff.service.library.here import function_of, run_of

    if run is not None:
        return run_of(read_document(run, Run), campaign_of(file))
    identified: TabledRun = function_of("identify")(file)
    return identified
