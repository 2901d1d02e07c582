"""Maps from files: of a campaign, by a run of it."""

from __future__ import annotations

from pathlib import Path

from jointstiff.schemas.map import Map, MapOptions, MapRequest
from jointstiff.schemas.run.run import Run
from jointstiff.service.kinds.map.work import MapWork
from jointstiff.service.library.campaigns import (
    OnProgress,
    carried_out,
    model_run,
    prepared_campaign,
    read_campaign,
    read_document,
)


def map_area(
    campaign: Path, request: Path, run: Path | None = None, on_progress: OnProgress | None = None
) -> tuple[Map, MapWork]:
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
    source, options = read_campaign(campaign), read_document(request, MapOptions)
    used = model_run(source, None if run is None else read_document(run, Run))
    prepared, made = prepared_campaign(source), []
    asked = MapRequest(run_id=used.id, **options.model_dump())

    def work() -> MapWork:
        made.append(MapWork(prepared.robot, prepared.robot_id, used, asked))
        return made[0]

    return carried_out(Map, asked, work, on_progress), made[0]
