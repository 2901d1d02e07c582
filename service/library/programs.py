"""Programs from files, corrected by the model of a campaign."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from jointstiff.schemas.campaign import Campaign
from jointstiff.schemas.job import Progress
from jointstiff.schemas.program import Program, ProgramOptions, ProgramRequest
from jointstiff.schemas.run.run import Run
from jointstiff.service.inputs.files import FromFile
from jointstiff.service.kinds.program import PROGRAM
from jointstiff.service.kinds.program.work import packed
from jointstiff.service.library.campaigns import add_model, carried_out
from jointstiff.service.library.errors import CampaignError
from jointstiff.service.problems.table import http_problem, invalid_request

MAX_BYTES = 16 * 1024 * 1024
"""All files of a program together, as the API has it."""


def compensate(
    campaign: Campaign,
    files: Sequence[Path],
    options: ProgramOptions,
    run: Run | None = None,
    on_progress: Callable[[Progress], object] | None = None,
) -> Program:
    """Correct the targets of a program.

    Args:
        campaign: robot and readings.
        files: the program, and the table of loads if the options name one.
        options: frames, loads, limits.
        run: of that campaign; identified now, as the campaign says, if None.
        on_progress: called with the progress of a long program.

    Raises:
        CampaignError: robot, readings, run, options or program cannot be used.
    """
    contents = [path.read_bytes() for path in files]
    if sum(map(len, contents)) > MAX_BYTES:
        raise CampaignError(http_problem(413, "the files exceed 16 MiB", "split the program"))
    inputs = FromFile()
    run_id = add_model(inputs, campaign, run)
    named = [packed(path.name, content) for path, content in zip(files, contents, strict=True)]
    request = ProgramRequest(run_id=run_id, files=named, **options.model_dump())
    return carried_out(PROGRAM, inputs, request, on_progress, section="")


def stated_options(file: Path | None, changes: dict[str, Any]) -> ProgramOptions:
    """Return the options of a file with some of them changed; without a file in m, degrees and N.

    Raises:
        CampaignError: they are no options, or do not go together.
    """
    stated: dict[str, Any] = {"units": {"length": "m", "angle": "deg", "force": "N"}}
    try:
        stated = stated if file is None else dict(json.loads(file.read_bytes()))
        return ProgramOptions.model_validate_json(json.dumps(stated | changes))
    except ValidationError as error:
        raise CampaignError(invalid_request(error.errors())) from None
    except (ValueError, TypeError):
        problem = http_problem(422, "the options are no JSON object", "correct that file")
        raise CampaignError(problem) from None
