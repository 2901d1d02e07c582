"""Commands of the kinds of work, made of their declarations and messages when they are called."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType, NoneType, UnionType
from typing import TYPE_CHECKING, Annotated, Any, Final, Literal, Union, get_args, get_origin

import typer
from typing_extensions import TypeAliasType

from jointstiff.schemas.deflection import DeflectionOptions
from jointstiff.schemas.fields import Message, Terminal, chain_of
from jointstiff.schemas.options import METHODS_IN_SHORT
from jointstiff.service.cli import options as cli
from jointstiff.service.kinds.kind import AnyKind
from jointstiff.service.kinds.rooms import ROOMS, kind_of

if TYPE_CHECKING:
    from pydantic.fields import FieldInfo

    from jointstiff.schemas.finding import Problem
    from jointstiff.schemas.job import Job

_Values = Mapping[str, Any]
_ARGUMENTS: Final[Mapping[str, Mapping[str, Any]]] = {
    "measurement_set": {"file": cli.CampaignFile},
    "run": {"file": cli.CampaignFile},
    "campaigns": {
        "file": cli.CampaignFile,
        "second": Annotated[
            Path | None,
            cli.file_argument(
                "[SECOND]", "Campaign to compare with: on secondary encoders, after a change, a twin."
            ),
        ],
    },
    "sets": {
        "files": Annotated[list[Path], cli.file_argument("FILES", "Campaigns, such as one of each robot.")]
    },
    "robot_or_set": {
        "source": Annotated[
            str,
            typer.Argument(
                metavar="ROBOT_OR_CAMPAIGN",
                help="To begin: file of a robot, or name of an arm of the catalogue. To continue: file of a "
                "campaign.",
            ),
        ]
    },
    "readings": {"file": Annotated[Path, cli.file_argument("FILE", "File of readings.")]},
    "files": {
        "program": Annotated[list[Path], cli.file_argument("PROGRAM", "Robot program; a .src with its .dat.")]
    },
}
"""Arguments of a command by what its kind is made of."""
_Options = Annotated[Path | None, cli.file_option("JSON file with further options, named as in the API.")]
_Output = Annotated[Path | None, cli.output_option("File to write the table to; its suffix sets the format.")]
_AsCsv = Annotated[bool, typer.Option("--csv", help="Print CSV for spreadsheets.")]


Forms = Mapping[str, Terminal]
_PLAIN: Final[Forms] = MappingProxyType({})
_ARM: Final = 6  # joints of an arm whose programs are compensated; others in a posture are linear axes


class Parsed:
    """A value that its option has parsed."""


@dataclass(frozen=True)
class _Extra:
    """Options of a command in addition to those of its kind's messages: files of the result."""

    options: Mapping[str, tuple[Any, Any]] = field(default_factory=dict)  # annotation and default by name
    endings: tuple[str, ...] = ()  # of the file that `output` names, if it is no table
    passed: tuple[str, ...] = ()  # names of those that the function of the work takes
    # writes files of a job that has a result; returns the job to show
    finish: Callable[[Any, _Values, Sequence[Any]], Any] = lambda job, _values, _sources: job
    # does something else in place of the work; returns whether it did
    instead: Callable[[_Values, Sequence[Any]], bool] = lambda _values, _sources: False
    # paths that the command will write
    written: Callable[[_Values, Sequence[Any]], Sequence[Path | None]] = lambda _values, _sources: ()


def command_of(name: str) -> Callable[..., None]:
    """Return the command of a kind of work, with a signature that Typer reads."""
    kind, extra = kind_of(name), _EXTRAS.get(name, _Extra())
    sources: dict[str, tuple[Any, Any]] = {
        key: (one, None if key == "second" else ...)
        for source in kind.sources
        for key, one in _ARGUMENTS[source].items()
    }
    fields = {key: (one, None) for key, one in field_options(kind.options)}
    endings = [f".{file.suffix}" for file in kind.files]
    tabled = "output" not in extra.options and ".csv" in endings

    def command(**values: Any) -> None:  # noqa: ANN401 - by the signature below
        given = [values[key] for key in sources if values[key] is not None]
        if extra.instead(values, given):
            return
        output = values.get("output")
        if output is not None and (tabled or extra.endings):
            cli.check_ending(output, endings if tabled else extra.endings, reported=True)
        written = list(filter(None, [output if tabled else None, *extra.written(values, given)]))
        for path in written:
            cli.refuse_existing(path, overwrite=values.get("overwrite", False))
        passed = {key: values[key] for key in extra.passed if values[key] is not None}
        job = _carry_out(kind, given, gathered(kind.options, values) | passed, values)
        if job.result is not None:
            job = extra.finish(job, values, given)
            if tabled and output is not None:
                output.write_bytes(job.table(output.suffix[1:]))
            for path in written:
                cli.warn(f"wrote {path}")
        _show(kind, job, values)

    others: dict[str, tuple[Any, Any]] = {"options": (_Options, None)}
    others |= {"run": (cli.RunFile, None)} if "run" in kind.sources else {}
    others |= dict(extra.options) | ({"output": (_Output, None), "as_csv": (_AsCsv, False)} if tabled else {})
    others |= {"overwrite": (cli.Overwrite, False)} if "output" in others else {}
    others |= {"unit": (cli.Unit, "MNm/rad"), "details": (cli.Details, False), "as_json": (cli.AsJson, False)}
    cli.with_signature(command, sources | fields | others)
    command.__doc__ = f"{ROOMS[name].summary}\n\ndocs/glossary.md explains the terms."
    return command


_POINTS: Final[Forms] = MappingProxyType(
    {
        "load_point": Terminal(
            metavar="X,Y,Z[mm]",
            parse=cli.point_of,
            text="Point where the force acts, in the flange frame, in mm.",
        ),
        "place": Terminal(
            metavar="X,Y,Z[mm]",
            parse=cli.point_of,
            text="Point whose deflection is predicted, in the flange frame, in mm; default: the load point.",
        ),
    }
)
_Postures = Annotated[
    Path,
    cli.file_argument(
        "POSTURES", "CSV of postures and loads, with units in the headers: J1 [deg], …, Fx [N], …"
    ),
]


def predict_command() -> Callable[..., None]:
    """Return the command `predict`, with an option for each field of its request."""

    def command(file: Path, postures: Path, **values: Any) -> None:  # noqa: ANN401 - by the signature below
        """Predict deflections in given postures under given loads."""
        from jointstiff.service.cli.models import identified
        from jointstiff.service.library import here
        from jointstiff.service.runs.deflection import prediction_csv, prediction_parts
        from jointstiff.service.tables.terminal import console, printed

        if values["output"] is not None:
            cli.check_ending(values["output"], [".csv"])
            cli.refuse_existing(values["output"], overwrite=values["overwrite"])
        stated = gathered(DeflectionOptions, values, _POINTS)
        result = here.predict(identified(file, values["run"]), postures, **stated)
        for remark in result.remarks:
            typer.echo(remark, err=True)
        if values["output"] is not None:
            cli.write_text(values["output"], prediction_csv(result))
        if values["as_json"]:
            typer.echo(result.model_dump_json(indent=2))
        else:
            console().print(printed(prediction_parts(result)))

    sources = {"file": (cli.CampaignFile, ...), "postures": (_Postures, ...), "run": (cli.RunFile, None)}
    fields = {key: (one, None) for key, one in field_options(DeflectionOptions, _POINTS)}
    output = _optional(cli.output_option("CSV file to write all numbers to."))
    shown = {"output": output, "overwrite": (cli.Overwrite, False), "as_json": (cli.AsJson, False)}
    cli.with_signature(command, sources | fields | shown)
    return command


def _carry_out(kind: AnyKind, sources: list[Any], stated: dict[str, Any], values: _Values) -> Job:
    """Carry the work out, as `import jointstiff` does."""
    from jointstiff.schemas.run import Run
    from jointstiff.service.library.here import Here, run_of
    from jointstiff.service.problems import CampaignError
    from jointstiff.service.resources.documents import campaign_of, read_document, read_object
    from jointstiff.service.tables.terminal import progress_bar

    if values["options"] is not None:
        options = read_object(values["options"])
        stated = options | _in_units_of(options, kind.options, stated)
    if values.get("run") is not None:
        sources = [run_of(read_document(values["run"], Run), campaign_of(sources[0])), *sources[1:]]
    given = [each for source in sources for each in (source if isinstance(source, list) else [source])]
    do = getattr(Here(), ROOMS[kind.name].command)
    try:
        stepped = kind.stepped or "campaigns" in kind.sources
        with progress_bar(shown=stepped) as tell:
            job: Job = do(*given, on_progress=tell if stepped else None, **stated)
    except CampaignError as error:
        raise CampaignError(in_options(kind.options, error.problem)) from error
    return job


def _in_units_of(file: dict[str, Any], message: type[Message], stated: dict[str, Any]) -> dict[str, Any]:
    """Return options of the command, in m, deg and N, in the units that a file of options states.

    Raises:
        typer.BadParameter: a posture has more joints than an arm, so linear axes, and the file's unit of
            angles is another.
    """
    from jointstiff.service.conversion.units import ANGLE, FORCE, LENGTH

    units = file.get("units")
    if not isinstance(units, dict):
        return stated
    sizes = {"m": ("length", LENGTH), "deg": ("angle", ANGLE), "N": ("force", FORCE)}
    scaled = dict(stated)
    for name, value in stated.items():
        quantity, size = sizes.get(_terminal(message.model_fields[name]).unit, ("", {}))
        unit = units.get(quantity)
        posture = quantity == "angle" and isinstance(value, list | tuple)
        if posture and unit != "deg" and unit in size and len(value) > _ARM:
            raise typer.BadParameter(
                f"linear axes are not in deg, and the file of options has angles in {unit}; remedy: state "
                f"`{name}` in that file, in its units",
                param_hint=flag_of(message, name),
            )
        if unit in size:
            scaled[name] = times(size[_terminal(message.model_fields[name]).unit] / size[unit], value)
    return scaled


def times(factor: float, value: Any) -> Any:  # noqa: ANN401 - JSON
    """Return a number, or all numbers in it, times a factor."""
    if isinstance(value, dict):
        return {key: times(factor, part) for key, part in value.items()}
    return [times(factor, part) for part in value] if isinstance(value, list | tuple) else factor * value


def worded(message: type[Message], text: str, forms: Forms = _PLAIN) -> str:
    """Return a text that names the command's options in place of the fields of a message."""
    with_option = dict(field_options(message, forms))

    def option(named: re.Match[str]) -> str:
        name, value = named.groups()
        if name not in with_option:
            return named[0]
        alone = value is None or _terminal(message.model_fields[name]).flag
        return f"`{flag_of(message, name, forms)}{'' if alone else f' {value}'}`"

    return re.sub(r"`(\w+)(?:: (\w+))?`", option, text)


def in_options(message: type[Message], problem: Problem, forms: Forms = _PLAIN) -> Problem:
    """Return a problem whose texts name the command's options in place of the request's fields."""
    from jointstiff.service.problems import MISSING

    with_option, items = dict(field_options(message, forms)), []
    for item in problem.errors:
        remedy = item.remedy and worded(message, item.remedy, forms)
        if item.reason == MISSING and item.where in message.model_fields:
            kind = _bare_type(message.model_fields[item.where].annotation)
            by_option = f"give `{flag_of(message, item.where, forms)}`"
            by_option += f": one of {', '.join(get_args(kind))}" if get_origin(kind) is Literal else ""
            remedy = by_option if item.where in with_option else "state it in the JSON file of `--options`"
        changes = {"reason": worded(message, item.reason, forms), "remedy": remedy}
        items.append(item.model_copy(update=changes))
    title = problem.title
    if items and all(re.split(r"\W", item.where)[0] in message.model_fields for item in items):
        title = "Options are missing or wrong"
    repeated = problem.remedy in {item.remedy for item in problem.errors}
    remedy = items[0].remedy if repeated else problem.remedy and worded(message, problem.remedy, forms)
    detail = worded(message, problem.detail, forms)
    return problem.model_copy(update={"title": title, "detail": detail, "remedy": remedy, "errors": items})


def _show(kind: AnyKind, job: Any, values: _Values) -> None:  # noqa: ANN401 - a job that shows itself
    """Print a job.

    Raises:
        typer.Exit: it has failed, or a set of a fleet has.
    """
    from jointstiff.service.reports.job import job_report
    from jointstiff.service.tables.terminal import console

    if values["as_json"]:
        typer.echo(kind.answered(job.model_dump_json(indent=2)))
    elif values.get("as_csv") and job.result is not None:
        typer.echo(job.table("csv").decode(), nl=False)
    else:
        if values.get("second") is not None:
            typer.echo(f"First: {values['file']}. Second: {values['second']}.")
        applies = kind.name == "run" and values["apply"] is None
        console().print(
            job_report(kind, job, details=values["details"], unit=values["unit"], applies=applies)
        )
    if job.state != "succeeded" or job.failed_parts:
        raise typer.Exit(1)


def field_options(message: type[Message], forms: Forms = _PLAIN) -> Iterator[tuple[str, Any]]:
    """Yield name and annotation of each field with an option; pydantic says which are missing.

    Args:
        message: the options.
        forms: forms of fields on the command line in place of those that the message states.
    """
    for name, stated in message.model_fields.items():
        terminal = _terminal(stated, forms.get(name))
        flag = flag_of(message, name, forms)
        text = terminal.text or " ".join((stated.description or "").split())
        if terminal.hidden:
            continue
        if terminal.flag:
            yield name, Annotated[bool | None, typer.Option(flag, help=text)]
        elif terminal.parse is not None:
            kind: Any = Parsed if terminal.gather == "one" else list[Parsed]
            text += "" if terminal.gather == "one" else " Repeatable."
            form: dict[str, Any] = {"parser": _parser_with_words(terminal.parse), "metavar": terminal.metavar}
            yield name, Annotated[kind | None, typer.Option(flag, help=text, **form)]
        elif (shape := _option_type(_bare_type(stated.annotation), terminal.unit)) is not None:
            kind, form = shape
            flag += f"/--no-{name.replace('_', '-')}" if kind is bool else ""
            yield name, Annotated[kind | None, typer.Option(flag, help=text, **form)]


def flag_of(message: type[Message], name: str, forms: Forms = _PLAIN) -> str:
    """Return the option of a field."""
    return _terminal(message.model_fields[name], forms.get(name)).option or f"--{name.replace('_', '-')}"


def gathered(message: type[Message], values: _Values, forms: Forms = _PLAIN) -> dict[str, Any]:
    """Return the fields that options state, from what these have parsed."""
    stated = {}
    for name, _ in field_options(message, forms):
        if values[name] not in (None, []):
            terminal = _terminal(message.model_fields[name], forms.get(name))
            value = dict(values[name]) if terminal.gather == "dict" else values[name]
            stated[name] = terminal.flag or value
    return stated


def _parser_with_words(parse: Callable[[str], Any]) -> Callable[[str], Any]:
    """Return a parser whose errors say what is wrong, which Click would replace by the text itself."""

    def parsed(text: str) -> Any:  # noqa: ANN401 - JSON
        try:
            return parse(text)
        except ValueError as error:
            raise typer.BadParameter(str(error)) from None

    return parsed


def _terminal(stated: FieldInfo, form: Terminal | None = None) -> Terminal:
    if form is not None:
        return form
    extra = stated.json_schema_extra
    unit = str(extra.get("unit", "")) if isinstance(extra, dict) else ""
    return next((each for each in stated.metadata if isinstance(each, Terminal)), Terminal(unit=unit))


def _option_type(kind: Any, unit: str) -> tuple[Any, dict[str, Any]] | None:  # noqa: ANN401 - a type
    """Return the type of an option and how it is parsed; None for a field that stays in the file."""
    if kind in {bool, int}:
        return kind, {}
    if get_origin(kind) is Literal:
        words = get_args(kind)
        return Parsed, {
            "parser": _parser_with_words(_one_of(words)),
            "metavar": f"<{'|'.join(words)}>",
            "autocompletion": lambda incomplete: [word for word in words if word.startswith(incomplete)],
        }
    if kind is str:
        return str, {"metavar": "TEXT"}
    if kind is float and unit in _SCALES:
        shown, factor = _SCALES[unit]
        return Parsed, {"parser": lambda text: factor * float(text), "metavar": f"NUMBER[{shown}]"}
    if kind is float:
        return float, {"metavar": "NUMBER"}
    parts = [_bare_type(part) for part in get_args(kind)]
    if get_origin(kind) is tuple and parts == [float] * 3:
        shown = {"m": "[mm]", "": "", "1": ""}.get(unit, f"[{unit}]")
        return Parsed, {"parser": cli.point_of if unit == "m" else cli.vector_of, "metavar": f"X,Y,Z{shown}"}
    if get_origin(kind) is list and (parts[0] is str or get_origin(parts[0]) is Literal):
        return Parsed, {"parser": chain_of, "metavar": "NAME,NAME,..."}
    return None


def _one_of(words: Sequence[str]) -> Callable[[str], str]:
    """Return a parser of words of the API, whose underlines people may write as hyphens."""

    def parse(text: str) -> str:
        word = METHODS_IN_SHORT.get(text.upper(), text.replace("-", "_"))
        if word not in words:
            raise ValueError(f"{text!r} is not one of {', '.join(map(repr, words))}.")
        return word

    return parse


_SCALES: Final[Mapping[str, tuple[str, float]]] = {
    "m": ("mm", 1e-3),
    "rad": ("deg", math.pi / 180.0),
    "deg": ("deg", 1.0),
}
"""Units of the terminal for those of the API, with their sizes."""


def _bare_type(annotation: Any) -> Any:  # noqa: ANN401 - a type
    """Return a type without its name, without `None` and without what `Annotated` says of it."""
    if isinstance(annotation, TypeAliasType):
        return _bare_type(annotation.__value__)
    origin = get_origin(annotation)
    if origin is Annotated:
        return _bare_type(get_args(annotation)[0])
    if origin in {Union, UnionType}:
        others = [each for each in get_args(annotation) if each is not NoneType]
        return _bare_type(others[0]) if len(others) == 1 else annotation
    return annotation


def _mended_file(values: _Values) -> Path | None:
    """Return where the mended campaign goes: next to the old one, unless the command names a place.

    Raises:
        typer.BadParameter: there is a file to write, and nothing to write to it.
    """
    output: Path | None = values["output"]
    if values["apply"] is None:
        if output is not None:
            others = "`jointstiff export` writes tables, `jointstiff report` reports"
            message = f"is the file of a campaign that --apply corrects; {others}"
            raise typer.BadParameter(message, param_hint="--output")
        return None
    if output is not None:
        cli.check_ending(output, [".json"])
    file, name = values["file"], values["apply"].replace("_", "-")
    return output or file.with_name(f"{file.stem}-{name}{file.suffix}")


def _apply(job: Any, values: _Values, _sources: Sequence[Any]) -> Any:  # noqa: ANN401 - runs
    """Apply an action, write the mended campaign, print a table of both runs, and return the new one."""
    from jointstiff.service.kinds.run.kind import before_and_after
    from jointstiff.service.tables.stiffness import UNITS
    from jointstiff.service.tables.terminal import console, printed

    path = _mended_file(values)
    if path is None:
        return job
    after = job.apply(values["apply"])
    document = after.campaign.model_dump(mode="json", exclude_none=True, exclude_defaults=True)
    cli.write_json(path, document)
    if after.result is not None and not values["as_json"]:
        console().print(printed([before_and_after(job.result, after.result, UNITS[values["unit"]])]))
    return after


def _write_robot(job: Any, values: _Values, _sources: Sequence[Any]) -> Any:  # noqa: ANN401 - a Geometry
    if values["output"] is not None:
        robot = job.result.robot.model_dump(mode="json", exclude_none=True)
        cli.write_json(values["output"], robot)
    return job


def _write_campaign(job: Any, values: _Values, sources: Sequence[Any]) -> Any:  # noqa: ANN401 - a Plan
    from jointstiff.service.kinds.plan.kind import campaign_to_fill_in
    from jointstiff.service.resources.documents import read_planned

    if values["campaign"] is not None:
        campaign = campaign_to_fill_in(read_planned(sources[0]), job)
        cli.write_json(values["campaign"], campaign)
    return job


def _outputs(values: _Values, sources: Sequence[Any]) -> dict[str, Path]:
    """Return where each file of a program goes: a .dat next to the .src."""
    output, several = values["output"], len(sources[1]) > 1
    return {each.name: output.with_suffix(each.suffix) if several else output for each in sources[1]}


def _print_moves(values: _Values, sources: Sequence[Any]) -> bool:
    """Print how the moves of a program are understood, if that is what is wanted."""
    from jointstiff.service.problems import CampaignError, FilesError, problem_of
    from jointstiff.service.programs.formats import explained
    from jointstiff.service.programs.program import ExternalAxes

    if not values["explain"]:
        if values["output"] is None:
            raise typer.BadParameter("is missing: name the file to write", param_hint="--output")
        return False
    files = [(path.name, path.read_bytes()) for path in sources[1]]
    try:
        external = ExternalAxes(values["external_axes"] or ExternalAxes.MAY_CARRY)
        rows = explained(files, values["format"], values["leave_alone"] or (), external)
    except FilesError as error:
        raise CampaignError(problem_of(error)) from error
    if values["as_json"]:
        typer.echo(json.dumps([row._asdict() for row in rows], indent=2))
        return True
    for row in rows:
        frames = f"base {row.base or 'unknown'}, tool {row.tool or 'unknown'}"
        verdict = "corrected" if row.corrected else f"left: {row.reason}; {row.remedy}"
        typer.echo(f"line {row.line}: {row.target or 'target unknown'}, {frames}: {verdict}")
    corrected = sum(row.corrected for row in rows)
    typer.echo(f"{corrected} of {len(rows)} moves can be corrected, {len(rows) - corrected} left")
    return True


def _write_program(job: Any, values: _Values, sources: Sequence[Any]) -> Any:  # noqa: ANN401 - a Program
    from jointstiff.service.kinds.program.work import unpacked

    outputs = _outputs(values, sources)
    for each in job.result.files:
        outputs[each.name].write_bytes(unpacked(each))
    if values["report"] is not None:
        values["report"].write_bytes(job.table("csv"))
    return job


def _optional(option: Any, kind: type = Path) -> tuple[Any, None]:  # noqa: ANN401 - Typer's
    """Return annotation and default of an option that may be absent."""
    return Annotated[kind | None, option], None


_EXTRAS: Final[Mapping[str, _Extra]] = {
    "run": _Extra(
        options={
            "apply": _optional(
                typer.Option(
                    metavar="ACTION",
                    help="Apply an action that a reason advises, such as exchange_columns or "
                    "convert_units: write the corrected campaign to a new file, and identify it.",
                ),
                str,
            ),
            "output": _optional(
                cli.output_option("File to write the corrected campaign to; default: next to the old one.")
            ),
        },
        finish=_apply,
        written=lambda values, _: [_mended_file(values)],
    ),
    "geometry": _Extra(
        options={
            "robot": (cli.NamedRobot, None),
            "output": _optional(cli.output_option("File to write the identified robot to.", "ROBOT.json")),
        },
        endings=(".json",),
        passed=("robot",),
        finish=_write_robot,
        written=lambda values, _: [values["output"]],
    ),
    "plan": _Extra(
        options={"campaign": _optional(cli.path_option("File to write the campaign to fill in to."))},
        finish=_write_campaign,
        written=lambda values, _: [values["campaign"]],
    ),
    "program": _Extra(
        options={
            "output": _optional(
                cli.output_option("File for the compensated program; a .dat is written to its folder.")
            ),
            "explain": (
                Annotated[
                    bool,
                    typer.Option(
                        "--explain",
                        help="Only print target, base and tool of each move, and why it is not corrected.",
                    ),
                ],
                False,
            ),
            "report": _optional(cli.path_option("CSV file to write all points to.")),
        },
        finish=_write_program,
        instead=_print_moves,
        written=lambda values, sources: [*_outputs(values, sources).values(), values["report"]],
    ),
}
