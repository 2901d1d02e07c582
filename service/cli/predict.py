"""The command `predict`: deflections by an identified model."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from jointstiff.service.cli.answers import refuse_existing, refused, write_text
from jointstiff.service.cli.options import (
    AsJson,
    CampaignFile,
    LoadPoint,
    Overwrite,
    RunFile,
    Vector,
    point_of,
)

if TYPE_CHECKING:
    from jointstiff.schemas.run.run import Run

_Table = Annotated[
    Path,
    typer.Argument(
        exists=True,
        dir_okay=False,
        metavar="POSTURES",
        help="CSV of postures and loads, with units in the headers: J1 [deg], …, Fx [N], …",
    ),
]


def predict(
    file: CampaignFile,
    postures: _Table,
    *,
    run: RunFile = None,
    load_point: LoadPoint = None,
    place: Annotated[
        Vector | None,
        typer.Option(
            parser=point_of,
            metavar="X,Y,Z[mm]",
            help="Point whose deflection is predicted, in the flange frame, in mm; default: the load point.",
        ),
    ] = None,
    confidence: Annotated[float, typer.Option(min=0.5, max=0.9999, help="Level of the intervals.")] = 0.95,
    output: Annotated[
        Path | None, typer.Option("--output", "-o", metavar="FILE", help="Write all numbers there, as CSV.")
    ] = None,
    overwrite: Overwrite = False,
    as_json: AsJson = False,
) -> None:
    """Predict deflections and compliance in given postures, under given loads, by a campaign's model."""
    from jointstiff.service.kinds.deflection.tables import prediction_csv, prediction_parts
    from jointstiff.service.library import campaigns
    from jointstiff.service.library.campaigns import read_campaign
    from jointstiff.service.library.errors import CampaignError
    from jointstiff.service.tables.terminal import console, printed

    if output is not None:
        refuse_existing(output, overwrite=overwrite)
    try:
        campaign = read_campaign(file)
        result = campaigns.predict(
            campaign,
            postures.read_text(encoding="utf-8-sig", errors="replace"),
            _run(run),
            load_point=load_point,
            place=place,
            confidence=confidence,
        )
    except CampaignError as error:
        raise refused(error.problem) from error
    for remark in result.remarks:
        typer.echo(remark, err=True)
    if output is not None:
        write_text(output, prediction_csv(result))
    if as_json:
        typer.echo(result.model_dump_json(indent=2))
    else:
        console().print(printed(prediction_parts(result)))


def _run(path: Path | None) -> Run | None:
    from jointstiff.schemas.run.run import Run
    from jointstiff.service.library import campaigns

    return None if path is None else campaigns.read_document(path, Run)
