"""Maps from files: of a campaign, by a run of it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from jointstiff.schemas.map import Map, MapOptions, MapRequest
from jointstiff.schemas.run.run import Run
from jointstiff.service.inputs.files import FromFile
from jointstiff.service.kinds.execution import carry_out, new_job
from jointstiff.service.kinds.map import MAP
from jointstiff.service.library.campaigns import (
    OnProgress,
    add_model,
    as_campaign_error,
    read_campaign,
    read_document,
)


def map_area(
    campaign: Path, request: Path, run: Path | None = None, on_progress: OnProgress | None = None
) -> tuple[Map, Any]:
    """Carry out one map.

    Args:
        campaign: file of robot and readings.
        request: file of the work area, the tool and the process.
        run: file of a run of that campaign; identified now, as the campaign says, if None.
        on_progress: called with the progress of a map that takes steps.

    Returns:
        The map, and its work, which has the table.

    Raises:
        CampaignError: the campaign, the run or the request cannot be used.
    """
    source, options, inputs = read_campaign(campaign), read_document(request, MapOptions), FromFile()
    run_id = add_model(inputs, source, None if run is None else read_document(run, Run))
    asked = MapRequest(run_id=run_id, **options.model_dump())
    with as_campaign_error(MAP.name):
        work = MAP.work(inputs, asked)
        return carry_out(new_job(Map, asked, work), work, on_progress), work
