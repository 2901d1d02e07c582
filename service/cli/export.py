"""The command `export`: an identified model as a file for other programs."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Final

import typer

from jointstiff.service.cli.answers import refuse_existing, refused, write_bytes
from jointstiff.service.cli.options import CampaignFile, DespiteVerdict, Overwrite, RunFile

if TYPE_CHECKING:
    from jointstiff.service.exporting.formats import ModelFormat

_FORMATS: Final[dict[str, ModelFormat]] = {
    ".csv": "csv",
    ".xlsx": "xlsx",
    ".urdf": "urdf",
    ".sdf": "sdf",
    ".mjcf": "mjcf",
    ".xml": "mjcf",
}


def export(
    file: CampaignFile,
    *,
    output: Annotated[
        Path,
        typer.Option(
            "--output",
            "-o",
            metavar="FILE",
            help="Write it there: .csv, .xlsx, .urdf, .sdf, .mjcf, or .xml, which is MJCF.",
        ),
    ],
    run: RunFile = None,
    despite_verdict: DespiteVerdict = False,
    overwrite: Overwrite = False,
) -> None:
    """Export a campaign's model: stiffness and intervals as a table, or springs for a simulator."""
    from jointstiff.schemas.run.run import Run
    from jointstiff.service.library import models
    from jointstiff.service.library.campaigns import read_campaign, read_document
    from jointstiff.service.library.errors import CampaignError

    found = _FORMATS.get(output.suffix.lower())
    if found is None:
        raise typer.BadParameter(f"ends in one of {', '.join(_FORMATS)}", param_hint="--output")
    refuse_existing(output, overwrite=overwrite)
    try:
        measured = None if run is None else read_document(run, Run)
        accepted = "do_not_use" if despite_verdict else None
        content = models.exported(read_campaign(file), found, measured, accepted)
    except CampaignError as error:
        raise refused(error.problem) from error
    write_bytes(output, content)
    typer.echo(f"{output}: {len(content):,} bytes")
