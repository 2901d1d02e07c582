"""The command `map`: how far the tool bends over a work area."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from jointstiff.service.cli.answers import failed, refuse_existing, refused
from jointstiff.service.cli.options import AsJson, CampaignFile, Overwrite, RunFile

_SUFFIXES = (".csv", ".npz")


def map_area(
    file: CampaignFile,
    request: Annotated[
        Path,
        typer.Argument(
            exists=True,
            dir_okay=False,
            metavar="REQUEST",
            help="JSON, as POST /v1/maps takes it, without run_id: work area, tool, process.",
        ),
    ],
    *,
    run: RunFile = None,
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", metavar="FILE", help="Write all places there, .csv or .npz."),
    ] = None,
    overwrite: Overwrite = False,
    as_json: AsJson = False,
) -> None:
    """Map a work area: deflection, compliance and intervals at each place, by a campaign's model."""
    from jointstiff.service.kinds.map import MAP
    from jointstiff.service.kinds.map.tables import places_sheet
    from jointstiff.service.kinds.report import job_report
    from jointstiff.service.library import maps
    from jointstiff.service.library.errors import CampaignError
    from jointstiff.service.tables.files import written
    from jointstiff.service.tables.terminal import console, progress_bar

    if output is not None:
        if output.suffix not in _SUFFIXES:
            raise typer.BadParameter("ends in .csv or .npz", param_hint="--output")
        refuse_existing(output, overwrite=overwrite)
    try:
        with progress_bar(shown=True) as show:
            found, work = maps.map_area(file, request, run, show)
    except CampaignError as error:
        raise refused(error.problem) from error
    if output is not None and found.result is not None:
        content = written(places_sheet(work), output.suffix.removeprefix("."))
        try:
            output.write_bytes(content)
        except OSError as error:
            raise failed(f"cannot write {output}: {error.strerror}", "choose another path") from error
    if as_json:
        typer.echo(found.model_dump_json(indent=2))
    else:
        console().print(job_report(MAP, found))
    if found.state != "succeeded":
        raise typer.Exit(1)
