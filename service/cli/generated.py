"""Commands of the kinds of work, made of their declarations and messages when they are called."""

from __future__ import annotations

import inspect
import json
import math
import re
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from types import NoneType, UnionType
from typing import TYPE_CHECKING, Annotated, Any, Final, Literal, Union, get_args, get_origin

import typer

from jointstiff.schemas.fields import Message
from jointstiff.schemas.terminal import Terminal, chain_of
from jointstiff.service.cli.answers import refuse_existing, write_bytes
from jointstiff.service.cli.extras import EXTRAS, Extra
from jointstiff.service.cli.options import (
    AsJson,
    CampaignFile,
    Details,
    Overwrite,
    RunFile,
    Unit,
    UnitChoice,
    file_argument,
    file_option,
    output_option,
    point_of,
    vector_of,
)
from jointstiff.service.kinds.kind import AnyKind
from jointstiff.service.kinds.rooms import ROOMS, kind_of

if TYPE_CHECKING:
    from pydantic.fields import FieldInfo

    from jointstiff.schemas.job import Job
    from jointstiff.schemas.problem import Problem

_File = Annotated[Path, file_argument("FILE", "File of readings.")]
_Files = Annotated[list[Path], file_argument("PROGRAM", "Robot program; a .src with its .dat.")]
_First = Annotated[
    Path,
    file_argument("FIRST", "Campaign with the position loop on the motors' encoders, or before a change."),
]
_Second = Annotated[
    Path,
    file_argument("SECOND", "Campaign with the position loop on secondary encoders, or after a change."),
]
_Source = Annotated[
    str,
    typer.Argument(
        metavar="ROBOT_OR_CAMPAIGN",
        help="To begin: file of a robot, or name of an arm of the catalogue. To continue: file of a "
        "campaign.",
    ),
]
_ARGUMENTS: Final[Mapping[str, Mapping[str, Any]]] = {
    "measurement_set": {"file": CampaignFile},
    "run": {"file": CampaignFile},
    "pair": {"first": _First, "second": _Second},
    "robot_or_set": {"source": _Source},
    "readings": {"file": _File},
    "files": {"program": _Files},
}
"""Arguments of a command by what its kind is made of."""
_Options = Annotated[Path | None, file_option("JSON file with further options, named as in the API.")]
_Output = Annotated[Path | None, output_option("File to write the table to; its suffix sets the format.")]
_AsCsv = Annotated[bool, typer.Option("--csv", help="Print CSV for spreadsheets.")]


class Parsed:
    """A value that its option has parsed."""


def command_of(name: str) -> Callable[..., None]:
    """Return the command of a kind of work, with a signature that Typer reads."""
    kind, extra = kind_of(name), EXTRAS.get(name, Extra())
    sources = {key: one for source in kind.sources for key, one in _ARGUMENTS[source].items()}
    fields = dict(_field_options(kind.options))
    tabled = _is_tabled(kind, extra)

    def command(**values: Any) -> None:  # noqa: ANN401 - by the signature below
        given = [values[key] for key in sources]
        stated = {key: values[key] for key in fields if values[key] not in (None, [])}
        if tabled:
            _refuse_other_endings(kind, values["output"])
        for path in [values.get("output"), *extra.written(values, given)]:
            if path is not None:
                refuse_existing(path, overwrite=values.get("overwrite", False))
        passed = {key: values[key] for key in extra.passed if values[key] is not None}
        gathered = {key: _gathered(kind, key, one) for key, one in stated.items()}
        job = _done(kind, given, gathered | passed, values)
        if job.result is not None:
            job = extra.finish(job, values, given) or job
            if tabled and values["output"] is not None:
                write_bytes(values["output"], _table(job, values["output"]))
        _show(kind, job, values)

    options = {key: (one, None) for key, one in fields.items()} | _common(kind, extra)
    command.__signature__ = inspect.Signature(  # type: ignore[attr-defined]
        [
            *(_parameter(key, one, ...) for key, one in sources.items()),
            *(_parameter(key, one, default) for key, (one, default) in options.items()),
        ]
    )
    command.__annotations__ = sources | {key: one for key, (one, _) in options.items()}
    command.__doc__ = f"{ROOMS[name].summary}\n\ndocs/glossary.md explains the terms."
    return command


def _parameter(name: str, annotation: Any, default: Any) -> inspect.Parameter:  # noqa: ANN401
    given = inspect.Parameter.empty if default is ... else default
    return inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, annotation=annotation, default=given)


def _refuse_other_endings(kind: AnyKind, output: Path | None) -> None:
    endings = [f".{file.suffix}" for file in kind.files]
    if output is not None and output.suffix not in endings:
        raise typer.BadParameter(f"ends in one of {', '.join(endings)}", param_hint="--output")


def _is_tabled(kind: AnyKind, extra: Extra) -> bool:
    """Return whether the output of a command is the table of its kind."""
    return "output" not in extra.options and any(file.suffix == "csv" for file in kind.files)


def _common(kind: AnyKind, extra: Extra) -> dict[str, tuple[Any, Any]]:
    """Return annotation and default of the options that do not come from the request."""
    options: dict[str, tuple[Any, Any]] = {"options": (_Options, None)}
    if "run" in kind.sources:
        options["run"] = (RunFile, None)
    options |= extra.options
    if _is_tabled(kind, extra):
        options |= {"output": (_Output, None), "as_csv": (_AsCsv, False)}
    if "output" in options:
        options["overwrite"] = (Overwrite, False)
    return options | {
        "unit": (Unit, UnitChoice.MEGA),
        "details": (Details, False),
        "as_json": (AsJson, False),
    }


def _done(kind: AnyKind, sources: list[Any], stated: dict[str, Any], values: dict[str, Any]) -> Job:
    """Carry the work out, as `import jointstiff` does."""
    from jointstiff.schemas.run import Run
    from jointstiff.service.library.errors import CampaignError
    from jointstiff.service.library.files import campaign_of, read_document
    from jointstiff.service.library.verbs import function_of, run_of
    from jointstiff.service.tables.terminal import progress_bar

    if values["options"] is not None:
        options = read_options(values["options"])
        units = options.get("units")
        if "load_point" in stated and isinstance(units, dict) and units.get("length") == "mm":
            stated["load_point"] = [1e3 * metres for metres in stated["load_point"]]
        stated = options | stated
    if values.get("run") is not None:
        run = run_of(read_document(values["run"], Run), campaign_of(sources[0]))
        sources = [run, *sources[1:]]
    given = [each for source in sources for each in (source if isinstance(source, list) else [source])]
    try:
        with progress_bar(shown=kind.stepped) as tell:
            do = function_of(ROOMS[kind.name].command)
            job: Job = do(*given, on_progress=tell if kind.stepped else None, **stated)
    except CampaignError as error:
        raise CampaignError(_in_options(kind, error.problem)) from error
    return job


def _in_options(kind: AnyKind, problem: Problem) -> Problem:
    """Return a problem whose remedies name the command's options in place of the request's fields."""
    fields = kind.options.model_fields
    flags = {f"`{name}`": f"`{_flag_of(name, fields[name])}`" for name, _ in _field_options(kind.options)}

    def renamed(remedy: str | None) -> str | None:
        return remedy and re.sub(r"`\w+`", lambda field: flags.get(field[0], field[0]), remedy)

    items = [item.model_copy(update={"remedy": renamed(item.remedy)}) for item in problem.errors]
    return problem.model_copy(update={"remedy": renamed(problem.remedy), "errors": items})


def read_options(path: Path) -> dict[str, Any]:
    """Read a file of options.

    Raises:
        CampaignError: it is no JSON object.
    """
    from jointstiff.service.library.errors import CampaignError
    from jointstiff.service.problems.table import http_problem

    try:
        return dict(json.loads(path.read_bytes()))
    except (ValueError, TypeError, RecursionError):
        raise CampaignError(
            http_problem(422, "the options are not a JSON object", "correct that file")
        ) from None


def _table(job: Any, path: Path) -> bytes:  # noqa: ANN401 - a job that shows itself
    try:
        content: bytes = job.table(path.suffix.removeprefix("."))
    except ValueError as error:
        raise typer.BadParameter(str(error), param_hint="--output") from None
    return content


def _show(kind: AnyKind, job: Job, values: Mapping[str, Any]) -> None:
    """Print a job.

    Raises:
        typer.Exit: it has failed.
    """
    from jointstiff.service.reports.job import job_report
    from jointstiff.service.tables.terminal import console

    if values["as_json"]:
        typer.echo(kind.answered(job.model_dump_json(indent=2)))
    elif values.get("as_csv") and job.result is not None:
        typer.echo(_table(job, Path("table.csv")).decode(), nl=False)
    else:
        console().print(job_report(kind, job, details=values["details"], unit=values["unit"]))
    if job.state != "succeeded":
        raise typer.Exit(1)


def _field_options(message: type[Message]) -> Iterator[tuple[str, Any]]:
    """Yield name and annotation of each field with an option; pydantic says which are missing."""
    for name, field in message.model_fields.items():
        terminal = _terminal(field)
        kind: Any
        form: dict[str, Any]
        if terminal.flag:
            kind, form = bool, {}
        elif terminal.parse is not None:
            kind = Parsed if terminal.gather == "one" else list[Parsed]
            form = {"parser": terminal.parse, "metavar": terminal.metavar}
        elif (shape := _shape(_bare(field.annotation), terminal.unit)) is not None:
            kind, form = shape
        else:
            continue
        flag = _flag_of(name, field)
        if kind is bool and not terminal.flag:
            flag += f"/--no-{name.replace('_', '-')}"
        text = " ".join((field.description or "").split())
        yield name, Annotated[kind | None, typer.Option(flag, help=text, **form)]


def _flag_of(name: str, field: FieldInfo) -> str:
    return _terminal(field).option or f"--{name.replace('_', '-')}"


def _terminal(field: FieldInfo) -> Terminal:
    stated = (each for each in field.metadata if isinstance(each, Terminal))
    extra = field.json_schema_extra
    unit = str(extra.get("unit", "")) if isinstance(extra, dict) else ""
    return next(stated, Terminal(unit=unit))


def _gathered(kind: AnyKind, name: str, value: Any) -> Any:  # noqa: ANN401 - JSON
    """Return the value of a field from what its option has parsed."""
    terminal = _terminal(kind.options.model_fields[name])
    if terminal.flag:
        return terminal.flag
    return dict(value) if terminal.gather == "dict" else value


def _shape(kind: Any, unit: str) -> tuple[Any, dict[str, Any]] | None:  # noqa: ANN401 - a type
    """Return the type of an option and how it is parsed; None for a field that stays in the file."""
    if kind in {bool, int} or get_origin(kind) is Literal:
        return kind, {}
    if kind is str:
        return str, {"metavar": "TEXT"}
    if kind is float and unit in _SCALES:
        shown, factor = _SCALES[unit]
        return Parsed, {"parser": lambda text: factor * float(text), "metavar": f"NUMBER[{shown}]"}
    if kind is float:
        return float, {"metavar": "NUMBER"}
    parts = [_bare(part) for part in get_args(kind)]
    if get_origin(kind) is tuple and parts == [float] * 3:
        shown = {"m": "[mm]", "": "", "1": ""}.get(unit, f"[{unit}]")
        return Parsed, {"parser": point_of if unit == "m" else vector_of, "metavar": f"X,Y,Z{shown}"}
    if get_origin(kind) is list and (parts[0] is str or get_origin(parts[0]) is Literal):
        return Parsed, {"parser": chain_of, "metavar": "NAME,NAME,..."}
    return None


_SCALES: Final[Mapping[str, tuple[str, float]]] = {"m": ("mm", 1e-3), "rad": ("deg", math.pi / 180.0)}
"""Units of the terminal for those of the API, with their sizes."""


def _bare(annotation: Any) -> Any:  # noqa: ANN401 - a type
    """Return a type without `None` and without what `Annotated` says of it."""
    origin = get_origin(annotation)
    if origin is Annotated:
        return _bare(get_args(annotation)[0])
    if origin in {Union, UnionType}:
        others = [each for each in get_args(annotation) if each is not NoneType]
        return _bare(others[0]) if len(others) == 1 else annotation
    return annotation
