"""Reading of saved results of any kind."""

from __future__ import annotations

import json
from collections.abc import Mapping
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, Literal, get_args, overload

from jointstiff.service.conversion.parsing import MAX_SET_BYTES
from jointstiff.service.kinds.retired import RETIRED
from jointstiff.service.kinds.rooms import ROOMS
from jointstiff.service.library.campaigns import Campaign
from jointstiff.service.library.here import restore_job
from jointstiff.service.library.rehearse import Rehearsal
from jointstiff.service.library.results import Prediction, Presented, RobotTrend
from jointstiff.service.problems import CampaignError, http_problem, naming_missing_file

if TYPE_CHECKING:
    from jointstiff.service.library.results import (
        TabledComparison,
        TabledCorrectionJob,
        TabledGeometry,
        TabledMap,
        TabledPlan,
        TabledRun,
    )

LoadedKind = Literal[
    "run",
    "comparison",
    "geometry",
    "map",
    "plan",
    "correction",
    "prediction",
    "rehearsal",
    "trend",
    "campaign",
]
"""Kind of a file that `load` reads."""

_MAX_BYTES: Final = 4 * MAX_SET_BYTES  # a run, its campaign, and the places of a map


def _list_classes() -> Mapping[str, type[Presented]]:
    """Return the classes of results that are no jobs, by the `kind` in their files."""
    classes = (Prediction, Rehearsal, RobotTrend)
    return {each._saved_kind: each for each in classes}


@overload
def load(path: str | PathLike[str], kind: None = None) -> Any: ...  # noqa: ANN401 - the class depends on the file
@overload
def load(path: str | PathLike[str], kind: Literal["run"]) -> TabledRun: ...
@overload
def load(path: str | PathLike[str], kind: Literal["comparison"]) -> TabledComparison: ...
@overload
def load(path: str | PathLike[str], kind: Literal["geometry"]) -> TabledGeometry: ...
@overload
def load(path: str | PathLike[str], kind: Literal["map"]) -> TabledMap: ...
@overload
def load(path: str | PathLike[str], kind: Literal["plan"]) -> TabledPlan: ...
@overload
def load(path: str | PathLike[str], kind: Literal["correction"]) -> TabledCorrectionJob: ...
@overload
def load(path: str | PathLike[str], kind: Literal["prediction"]) -> Prediction: ...
@overload
def load(path: str | PathLike[str], kind: Literal["rehearsal"]) -> Rehearsal: ...
@overload
def load(path: str | PathLike[str], kind: Literal["trend"]) -> RobotTrend: ...
@overload
def load(path: str | PathLike[str], kind: Literal["campaign"]) -> Campaign: ...
def load(path: str | PathLike[str], kind: LoadedKind | None = None) -> Any:
    """Read a result that `save("….json")` wrote, or a campaign file.

    Args:
        path: JSON file of a result of any kind, or of a campaign.
        kind: kind of the result, such as "run"; another one is refused, and editors know the result's fields.
            Default: any kind.

    Returns:
        The result, an object of the same class with the same numbers. Tables, plots and reports of the result
        are made in this process. A run has its campaign, so that every verb accepts it. A job that the API
        or `--json` has written has no campaign: its tables and plots are there, further work is refused.

    Raises:
        CampaignError: the file has neither a result nor a campaign, is of another kind, or exceeds 32 MiB.
        OSError: the file cannot be read.
        TypeError: `kind` is no kind of result.
    """
    if kind is not None and kind not in get_args(LoadedKind):
        raise TypeError(f"kind must be one of: {', '.join(get_args(LoadedKind))}; not {kind!r}")
    file = Path(path)
    with naming_missing_file():
        size = file.stat().st_size
    if size > _MAX_BYTES:
        limit = f"{_MAX_BYTES // 1024**2} MiB"
        raise CampaignError(http_problem(413, f"{file} exceeds {limit}", "save a smaller result"))
    with naming_missing_file():
        content = file.read_bytes()
    try:
        document = json.loads(content)
    except (ValueError, RecursionError):
        document = None
    if isinstance(document, dict) and {"cases", "model_error_postures"} <= document.keys():
        document = {"kind": "prediction"} | document
    is_result = isinstance(document, dict) and "kind" in document
    found = document["kind"] if is_result else "campaign"
    # The error for a file that has neither names the kind of file, or its faults
    loaded = restore(document, str(path)) if is_result else Campaign.read(path)
    if kind not in (None, found):
        reason = f"{path} has the kind '{found}', not '{kind}'"
        raise CampaignError(http_problem(422, reason, f'use `jointstiff.load("{path}", "{found}")`'))
    return loaded


def restore(document: Mapping[str, Any], name: str = "the document") -> Any:  # noqa: ANN401 - any result
    """Return the result of a saved document; `name` is the file's name for people.

    Raises:
        CampaignError: the document is no result.
    """
    classes = _list_classes()
    kind = str(document.get("kind"))
    if kind in classes:
        return classes[kind]._from_fields(document)
    if kind not in {*ROOMS, *RETIRED}:
        known = ", ".join(sorted({*ROOMS, *classes}))
        raise CampaignError(
            http_problem(422, f"{name} has the unknown kind '{kind}'", f"load a file of one of: {known}")
        )
    return restore_job(document)
