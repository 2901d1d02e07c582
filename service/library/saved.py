"""Saved results: JSON with what is needed to use a result again, and the function that reads it.

A file has the fields of the API's message, and after them what the message only names by an id: a run its
`campaign`, a plan the campaign that the plan `continues`, a map of this process the saved run (`made_from`)
by which its places are computed again, a map or program of a service its `tables` and `files`.
"""

from __future__ import annotations

import json
from base64 import b64decode, b64encode
from collections.abc import Mapping
from contextlib import suppress
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final, Literal, cast, get_args, overload

from pydantic import BeforeValidator, Field

from jointstiff.schemas.fields import Message
from jointstiff.schemas.job import Job
from jointstiff.schemas.plan import Plan
from jointstiff.schemas.run import Campaign as CampaignMessage
from jointstiff.schemas.run import Run
from jointstiff.service.conversion.parsing import MAX_SET_BYTES
from jointstiff.service.history.raising import raise_document, recognize_kind
from jointstiff.service.history.steps import NEWEST
from jointstiff.service.kinds.rooms import ROOMS, import_kind
from jointstiff.service.library import results
from jointstiff.service.library.campaigns import Campaign, extract_run_options
from jointstiff.service.library.here import Here
from jointstiff.service.library.results import Prediction, Presented, PresentedJob, RobotTrend, TabledRun
from jointstiff.service.problems import CampaignError, http_problem
from jointstiff.service.resources.documents import parse_document
from jointstiff.service.tables.table import Sheet

if TYPE_CHECKING:
    from jointstiff.service.kinds.comparison.verb import TabledComparison
    from jointstiff.service.kinds.fleet.verb import TabledFleet
    from jointstiff.service.kinds.geometry.verb import TabledGeometry
    from jointstiff.service.kinds.map.verb import TabledMap
    from jointstiff.service.kinds.plan.verb import TabledPlan
    from jointstiff.service.kinds.process.verb import TabledProcess
    from jointstiff.service.kinds.program.verb import TabledProgram
    from jointstiff.service.library.imported import ImportedReadings
    from jointstiff.service.library.rehearse import Rehearsal

LoadedKind = Literal[
    "run",
    "comparison",
    "fleet",
    "geometry",
    "map",
    "plan",
    "process",
    "program",
    "prediction",
    "rehearsal",
    "trend",
    "imported",
    "campaign",
]
"""Kind of a file that `load` reads."""

_MAX_BYTES: Final = 4 * MAX_SET_BYTES  # a run, its campaign, and the places of a map


def _decode(text: object) -> bytes:
    """Return the bytes of a text in base64; raise ValueError for another text."""
    return b64decode(str(text), validate=True)


_Content = Annotated[bytes, BeforeValidator(_decode)]


_VERSION: Final = "schema"
"""Field of a file: version of its documents; files of earlier versions do not have the field."""
_CAMPAIGNS: Final = frozenset({"campaign", "continues"})
"""Parts of a saved job that are campaigns."""


class _SavedTable(Message):
    """Table of a job of a service: values by header, and the headers of columns of text."""

    columns: dict[str, list[float | int | str | bool | None]]
    texts: list[str]


class _SavedParts(Message):
    """Parts of a saved job that are not fields of its message."""

    campaign: CampaignMessage | None = None
    continues: CampaignMessage | None = None
    made_from: dict[str, Any] | None = None
    tables: dict[str, _SavedTable] = Field(default_factory=dict)
    files: dict[str, _Content] = Field(default_factory=dict)


def _list_classes() -> Mapping[str, type[Presented]]:
    """Return the classes of results that are no jobs, by the `kind` in their files."""
    from jointstiff.service.library.imported import ImportedReadings
    from jointstiff.service.library.rehearse import Rehearsal

    return {
        "imported": ImportedReadings,
        "prediction": Prediction,
        "rehearsal": Rehearsal,
        "trend": RobotTrend,
    }


@overload
def load(path: str | PathLike[str], kind: None = None) -> Any: ...  # noqa: ANN401 - the class depends on the file
@overload
def load(path: str | PathLike[str], kind: Literal["run"]) -> TabledRun: ...
@overload
def load(path: str | PathLike[str], kind: Literal["comparison"]) -> TabledComparison: ...
@overload
def load(path: str | PathLike[str], kind: Literal["fleet"]) -> TabledFleet: ...
@overload
def load(path: str | PathLike[str], kind: Literal["geometry"]) -> TabledGeometry: ...
@overload
def load(path: str | PathLike[str], kind: Literal["map"]) -> TabledMap: ...
@overload
def load(path: str | PathLike[str], kind: Literal["plan"]) -> TabledPlan: ...
@overload
def load(path: str | PathLike[str], kind: Literal["process"]) -> TabledProcess: ...
@overload
def load(path: str | PathLike[str], kind: Literal["program"]) -> TabledProgram: ...
@overload
def load(path: str | PathLike[str], kind: Literal["prediction"]) -> Prediction: ...
@overload
def load(path: str | PathLike[str], kind: Literal["rehearsal"]) -> Rehearsal: ...
@overload
def load(path: str | PathLike[str], kind: Literal["trend"]) -> RobotTrend: ...
@overload
def load(path: str | PathLike[str], kind: Literal["imported"]) -> ImportedReadings: ...
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
    if file.stat().st_size > _MAX_BYTES:
        limit = f"{_MAX_BYTES // 1024**2} MiB"
        raise CampaignError(http_problem(413, f"{file} exceeds {limit}", "save a smaller result"))
    content = file.read_bytes()
    try:
        document = json.loads(content)
    except (ValueError, RecursionError):
        document = None
    if recognized := recognize_kind(document):
        document = {"kind": recognized} | document
    is_result = isinstance(document, dict) and "kind" in document
    found = document["kind"] if is_result else "campaign"
    # The error for a file that has neither names the kind of file, or its faults
    loaded = restore(document, str(path)) if is_result else Campaign.read(path)
    if kind not in (None, found):
        reason = f"{path} has the kind '{found}', not '{kind}'"
        raise CampaignError(http_problem(422, reason, f'use `jointstiff.load("{path}", "{found}")`'))
    return loaded


def restore(document: Mapping[str, Any], name: str = "the document") -> Any:  # noqa: ANN401 - any result
    """Return the result of a document that `to_document` returned; `name` is the file's name for people.

    Raises:
        CampaignError: the document is no result.
    """
    fields, classes = dict(document), _list_classes()
    kind = str(fields.get("kind"))
    version = fields.pop(_VERSION, None)
    version = version if isinstance(version, int) else None
    fields = _raise_part(kind, fields, version)
    if kind in classes:
        message = cast("Any", classes[kind])
        del fields["kind"]
        robot = fields.pop("robot", None)
        result = parse_document(fields, message)
        return result if robot is None else result.with_robot(robot)
    if kind not in ROOMS:
        known = ", ".join(sorted({*ROOMS, *classes}))
        raise CampaignError(
            http_problem(422, f"{name} has the unknown kind '{kind}'", f"load a file of one of: {known}")
        )
    saved = {part: fields.pop(part) for part in _SavedParts.model_fields if part in fields}
    for part in _CAMPAIGNS & saved.keys():
        saved[part] = _raise_part("campaign", saved[part], version)
    parts = parse_document(saved, _SavedParts)
    if parts.campaign is not None and isinstance(fields.get("request"), dict):
        # The options are those of the campaign: there, options that nobody stated keep their defaults, which
        # other options may change.
        ids = {name: fields["request"].get(name) for name in ("measurement_set_id", "variant_of")}
        fields["request"] = ids | parts.campaign.run.model_dump(mode="json", exclude_unset=True)
    job = parse_document(fields, import_kind(kind).message)
    here = Here(parts.campaign or parts.continues)
    if parts.made_from is not None and parts.made_from.get("kind") == Run.kind_name():
        here.source = restore(parts.made_from)
    here.tables = {name: Sheet(part.columns, frozenset(part.texts)) for name, part in parts.tables.items()}
    here.files = parts.files
    return results.attach_origin(cast("Job", job), here)


def _raise_part(kind: str, part: Any, version: int | None) -> Any:  # noqa: ANN401 - any JSON
    """Return a part of a file, raised to today's shape; unchanged if it cannot be raised."""
    if not isinstance(part, dict):
        return part
    with suppress(ValueError):  # the checks of today's shape name what is wrong
        return raise_document(kind, part, version).document
    return part


def to_document(result: Presented) -> dict[str, Any]:
    """Return a result as a document that `restore` reads.

    Raises:
        RefusedError: the service that did the work does not answer, or has deleted the campaign.
    """
    fields: dict[str, Any] = result._message.model_dump(mode="json")
    if not isinstance(result, PresentedJob):
        (kind,) = (kind for kind, message in _list_classes().items() if isinstance(result, message))
        robot = getattr(result, "robot", None) if kind == "imported" else None
        extra = {} if robot is None else {"robot": robot.model_dump(mode="json", exclude_unset=True)}
        return {"kind": kind, _VERSION: NEWEST} | fields | extra
    if isinstance(result, TabledRun):
        campaign = None if result._origin is None else result._origin.read_campaign(result)
        if campaign is not None:
            campaign = campaign.model_copy(update={"run": extract_run_options(result)})
            fields["campaign"] = campaign.model_dump(mode="json", exclude_unset=True)
    elif result._origin is not None:
        if isinstance(result, Plan) and (continued := result._origin.read_campaign(result)) is not None:
            fields["continues"] = continued.model_dump(mode="json", exclude_unset=True)
        if (run := result._origin.find_run_for_tables(result)) is not None:
            fields["made_from"] = to_document(run)
        fields |= _describe_contents(*result._origin.read_contents(result))
    return fields | {_VERSION: NEWEST}


def _describe_contents(tables: Mapping[str, Sheet], files: Mapping[str, bytes]) -> dict[str, Any]:
    """Return the fields of a document for tables and files that the message of a job leaves out."""
    described = {
        name: {
            "columns": {head: list(values) for head, values in sheet.columns.items()},
            "texts": sorted(sheet.texts),
        }
        for name, sheet in tables.items()
    }
    contents = {name: b64encode(content).decode() for name, content in files.items()}
    return {key: value for key, value in (("tables", described), ("files", contents)) if value}


def use_saved(source: Any) -> Any:  # noqa: ANN401 - a source of a verb
    """Return the run in a saved file; return any other source of a verb unchanged."""
    if not isinstance(source, str | PathLike) or not Path(source).is_file():
        return source
    try:
        document = json.loads(Path(source).read_bytes())
    except (ValueError, RecursionError):
        return source  # the verb names what is wrong
    is_run = isinstance(document, dict) and document.get("kind") == Run.kind_name() and "campaign" in document
    return restore(document, str(source)) if is_run else source


def from_pickle(text: str) -> Any:  # noqa: ANN401 - any result
    """Return a result from the text to which it was pickled."""
    return restore(json.loads(text))
