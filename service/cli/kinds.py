"""Commands of the kinds of work, such as `identify`, and the command `predict`.

A command is made from the declaration and the options of its kind when it is called.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Annotated, Any, Final

import typer

from jointstiff.schemas.correction import CorrectionOptions, Cut, are_programs
from jointstiff.schemas.deflection import DeflectionOptions
from jointstiff.schemas.fields import Message, Terminal
from jointstiff.schemas.finding import AcceptingOptions
from jointstiff.service.cli import options as cli
from jointstiff.service.cli.fields import (
    Forms,
    field_options,
    find_option_form,
    gather_stated_fields,
    name_options_in_text,
    naming_options,
    option_flag,
)
from jointstiff.service.kinds.kind import AnyKind
from jointstiff.service.kinds.rooms import ROOMS, import_kind

if TYPE_CHECKING:
    from jointstiff.schemas.deflection import DeflectionResult
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
                "[SECOND]",
                "File of a second campaign to compare with the first. The second campaign has secondary "
                "encoders, follows a change, or is of a robot of the same model.",
            ),
        ],
    },
    "sets": {
        "files": Annotated[
            list[Path], cli.file_argument("FILES", "Files of campaigns, such as one campaign of each robot.")
        ]
    },
    "robot_or_set": {
        "source": Annotated[
            str,
            typer.Argument(
                metavar="ROBOT_OR_CAMPAIGN",
                help="Robot of a new campaign: a file, a URDF, or the name of an arm of the catalogue. To "
                "continue a campaign, its file.",
            ),
        ]
    },
    "run_or_robot": {
        "source": Annotated[
            str,
            typer.Argument(
                metavar="CAMPAIGN_OR_ROBOT",
                help="File of a campaign. If no campaign was measured: file of a robot, or name of an arm "
                "of the catalogue.",
            ),
        ]
    },
    "readings": {"file": Annotated[Path, cli.file_argument("FILE", "File of readings.")]},
    "files": {
        "poses": Annotated[
            list[Path],
            cli.file_argument(
                "POSES",
                "CSV or Parquet of poses, with units in the headers: x [mm], …, rx [deg], …; if known "
                "J1 [deg], …; Fx [N], … Or a robot program. KUKA: the .src and .dat files. ABB: the modules "
                "of the task. FANUC: the .LS file and the .LS files that it calls.",
            ),
        ]
    },
}
"""Name of a source of a kind of work → arguments of the command: name → annotation."""
_Options = Annotated[Path | None, cli.file_option("JSON file with further options, named as in the API.")]
_Output = Annotated[Path | None, cli.output_option("File to write the table to; its suffix sets the format.")]
_Save = Annotated[
    Path | None,
    cli.path_option("File for the whole result, which every command reads.", "RESULT.json"),
]
_AsCsv = Annotated[bool, typer.Option("--csv", help="Print CSV for spreadsheets.")]


_FRAME_UNITS: Final = "mm,deg"  # units of the option of a frame
_JOINTS_OF_ARM: Final = 6  # number of an arm's joints; further joints of a posture are linear axes


@dataclass(frozen=True)
class _FileOptions:
    """Options of a command that concern files, and the functions that carry out these options."""

    options: Mapping[str, tuple[Any, Any]] = field(default_factory=dict)  # name → (annotation, default)
    endings: tuple[str, ...] = ()  # allowed endings of the file of --output, if it is not a table
    passed_options: tuple[str, ...] = ()  # names of options that are passed on to the function of the work
    # function that writes the files of a job with a result, and returns the job to print
    finish: Callable[[Any, _Values, Sequence[Any]], Any] = lambda job, _values, _sources: job
    # function that returns True if it did something in place of the work, as the option --explain requests
    replace_work: Callable[[_Values, Sequence[Any]], bool] = lambda _values, _sources: False
    # function that returns the paths of the files that the command will write
    list_paths: Callable[[_Values, Sequence[Any]], Sequence[Path | None]] = lambda _values, _sources: ()


def build_command(name: str) -> Callable[..., None]:
    """Return the function of the command of a kind of work, such as `identify`, with its options."""
    declared = _DeclaredCommand.from_kind(name)

    def command(**values: Any) -> None:  # noqa: ANN401 - the signature set below has the types
        kind, file_options = declared.kind, declared.file_options
        source_values = [values[name] for name in declared.sources if values[name] is not None]
        if file_options.replace_work(values, source_values):
            return
        # The files to write are checked first, so that no finished work is lost because of a wrong name.
        written = declared.check_files(values, source_values)
        stated_fields = gather_stated_fields(kind.options, values) | declared.find_passed_options(values)
        done_job = _run_work(kind, source_values, stated_fields, values)
        if done_job.result is not None:
            done_job = file_options.finish(done_job, values, source_values)
            written.write(done_job)
        _print_job(kind, done_job, values)

    cli.set_signature(command, declared.list_parameters())
    command.__doc__ = f"{ROOMS[name].summary}\n\ndocs/glossary.md explains the terms."
    return command


_Parameters = dict[str, tuple[Any, Any]]
"""Name of an argument or option of a command → (annotation for Typer, default)."""


@dataclass(frozen=True)
class _WrittenFiles:
    """Files that a command writes after its work."""

    table: Path | None  # for the main table of the job
    result: Path | None  # for the whole result as JSON
    paths: Sequence[Path]  # of all files, also those that the kind of work writes itself

    def write(self, job: Any) -> None:  # noqa: ANN401 - a job with files
        """Write the main table of a job and its whole result, and print the paths of all files."""
        if self.table is not None:
            self.table.write_bytes(job.table(self.table.suffix[1:]))
        if self.result is not None:
            job.save(self.result)
        for path in self.paths:
            cli.warn(f"wrote {path}")


@dataclass(frozen=True)
class _DeclaredCommand:
    """Declaration of the command of a kind of work: what it reads, and which files it writes."""

    kind: AnyKind
    sources: _Parameters  # arguments, such as the file of a campaign
    file_options: _FileOptions
    table_endings: Sequence[str]  # endings of the files that can contain the main table: .csv, …

    @classmethod
    def from_kind(cls, name: str) -> _DeclaredCommand:
        """Return the declaration of the command of a kind of work."""
        kind = import_kind(name)
        sources: _Parameters = {}
        for source in kind.sources:
            for argument, annotation in _ARGUMENTS[source].items():
                is_required = argument != "second"  # only the second campaign may be omitted
                sources[argument] = (annotation, ... if is_required else None)
        endings = [f".{file.suffix}" for file in kind.files]
        return cls(kind, sources, _FILE_OPTIONS.get(name, _FileOptions()), endings)

    @property
    def writes_table(self) -> bool:
        """True if `--output` names a file for the main table: the kind has tables, but no own `--output`."""
        return "output" not in self.file_options.options and ".csv" in self.table_endings

    def list_parameters(self) -> _Parameters:
        """Return the arguments and options of the command, in the order of its help."""
        options: _Parameters = {"options": (_Options, None)}
        if {"run", "run_or_robot"} & {*self.kind.sources}:
            options["run"] = (cli.RunFile, None)
        options |= self.file_options.options
        if self.writes_table:
            options |= {"output": (_Output, None), "as_csv": (_AsCsv, False)}
        options |= {
            "save": (_Save, None),
            "overwrite": (cli.Overwrite, False),
            "unit": (cli.Unit, "MNm/rad"),
            "details": (cli.Details, False),
            "as_json": (cli.AsJson, False),
        }
        fields = {name: (annotation, None) for name, annotation in field_options(self.kind.options)}
        return self.sources | fields | options

    def check_files(self, values: _Values, source_values: Sequence[Any]) -> _WrittenFiles:
        """Return the files that the command will write, by the values of its options.

        Raises:
            typer.BadParameter: a file has a wrong ending.
            typer.Exit: a file exists, and is not to be overwritten.
        """
        output, save = values.get("output"), values["save"]
        if save is not None:
            cli.check_ending(save, [".json"], option="--save")
        if output is not None and (self.writes_table or self.file_options.endings):
            allowed = self.table_endings if self.writes_table else self.file_options.endings
            cli.check_ending(output, allowed, reported=True, saved=True)
        table = output if self.writes_table else None
        named_paths = [table, save, *self.file_options.list_paths(values, source_values)]
        paths = [path for path in named_paths if path]
        inputs = cli.list_inputs(values)
        for path in paths:
            cli.refuse_existing(path, overwrite=values["overwrite"], inputs=inputs)
        return _WrittenFiles(table, save, paths)

    def find_passed_options(self, values: _Values) -> dict[str, Any]:
        """Return the values of options that are passed on to the function of the work, such as `robot`."""
        names = self.file_options.passed_options
        return {name: values[name] for name in names if values[name] is not None}


_POINT_FORMS: Final[Forms] = MappingProxyType(
    {
        "load_point": Terminal(
            metavar="X,Y,Z[mm]",
            parse=cli.parse_point,
            text="Point where the force acts, in the flange frame, in mm.",
        ),
        "place": Terminal(
            metavar="X,Y,Z[mm]",
            parse=cli.parse_point,
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


def build_predict_command() -> Callable[..., None]:
    """Return the function of the command `predict`, with an option for each field of its request."""

    def command(file: Path, postures: Path, **values: Any) -> None:  # noqa: ANN401 - the signature set below has the types
        """Predict deflections in given postures under given loads."""
        _refuse_exchanged(file, postures, "FILE POSTURES")
        if values["output"] is not None:
            cli.check_ending(values["output"], [".csv"])
            inputs = [file, postures, *cli.list_inputs(values)]
            cli.refuse_existing(values["output"], overwrite=values["overwrite"], inputs=inputs)
        _show_predictions(_predict(file, postures, values), values)

    sources = {"file": (cli.CampaignFile, ...), "postures": (_Postures, ...), "run": (cli.RunFile, None)}
    fields = {key: (annotation, None) for key, annotation in field_options(DeflectionOptions, _POINT_FORMS)}
    output = _make_optional_parameter(cli.output_option("CSV file to write all numbers to."))
    output_options = {"output": output, "overwrite": (cli.Overwrite, False), "as_json": (cli.AsJson, False)}
    cli.set_signature(command, sources | fields | output_options)
    return command


def _predict(file: Path, postures: Path, values: _Values) -> DeflectionResult:
    """Return the predicted deflections in the postures of a table, by the run of a campaign.

    Args:
        file: file of the campaign, which is identified unless `--run` names the file of its run.
        postures: table of postures and loads.
        values: values of all options.

    Raises:
        CampaignError: a file or an option cannot be used; the texts name options in place of fields.
    """
    from jointstiff.service.cli.models import read_or_identify_run
    from jointstiff.service.library import here

    stated = gather_stated_fields(DeflectionOptions, values, _POINT_FORMS)
    stated.setdefault("units", "m, rad, N")  # of the numbers that the options were parsed to
    run = read_or_identify_run(file, values["run"])
    with naming_options(DeflectionOptions, _POINT_FORMS):
        return here.predict(run, postures, **stated)


def _show_predictions(result: DeflectionResult, values: _Values) -> None:
    """Print predictions as a report or JSON; write them as CSV if `--output` names a file."""
    from jointstiff.service.runs.deflection import describe_predictions, prediction_csv
    from jointstiff.service.tables.terminal import console, lay_out_parts

    for remark in result.remarks:
        typer.echo(remark, err=True)
    if values["output"] is not None:
        cli.write_text(values["output"], prediction_csv(result))
    if values["as_json"]:
        typer.echo(result.model_dump_json(indent=2))
    else:
        console().print(lay_out_parts(describe_predictions(result)))


def _refuse_exchanged(source: Path, table: Path, order: str) -> None:
    """Refuse a table of rows and a JSON document in each other's place.

    Raises:
        typer.Exit: the arguments are exchanged.
    """
    is_exchanged = source.suffix.lower() in (".csv", ".parquet") and table.suffix.lower() == ".json"
    if is_exchanged:
        raise cli.print_failure(
            f"{source} and {table} are in the wrong order: the right order is {order}",
            f"write {table} {source}",
        )


def _correct_table(file: str, poses: Path, values: _Values) -> None:
    """Correct a table of poses: print counts and remarks, and write the rows if `--output` names a file.

    Raises:
        typer.BadParameter: an option holds only for programs.
        typer.Exit: no row is corrected.
    """
    from jointstiff.service.runs.correction.verdict import WITHOUT_NUMBERS

    for name in ("save", "report", "as_json"):
        if values[name]:
            option = "--json" if name == "as_json" else f"--{name}"
            raise typer.BadParameter("holds only for a robot program: omit it", param_hint=option)
    output: Path | None = values["output"]
    if output is not None:
        cli.check_ending(output, [".csv", ".parquet"])
        inputs = [file, poses, *cli.list_inputs(values)]
        cli.refuse_existing(output, overwrite=values["overwrite"], inputs=inputs)
    kind = import_kind("correction")
    result: Any = _run_work(kind, [file, poses], gather_stated_fields(CorrectionOptions, values), values)
    has_numbers = bool(result.counts.keys() - WITHOUT_NUMBERS)
    if output is not None and has_numbers:
        result.save(output)
        cli.warn(f"wrote {output}")
    typer.echo(name_options_in_text(CorrectionOptions, result.summary()))
    if not has_numbers:
        if output is not None:
            cli.warn(f"{output} was not written: no row is corrected")
        raise typer.Exit(1)


def _run_work(kind: AnyKind, sources: list[Any], stated_fields: dict[str, Any], values: _Values) -> Job:
    """Do the work of a command in this process, and return the job with its result.

    Args:
        kind: kind of the work.
        sources: values of the arguments, such as the file of a campaign.
        stated_fields: fields that options of the command state; they take precedence over the file of
            --options.
        values: values of all options.

    Raises:
        CampaignError: sources or options cannot be used; the texts name options in place of fields.
    """
    from jointstiff.service.cli.models import read_or_identify_run
    from jointstiff.service.library.here import Here
    from jointstiff.service.tables.terminal import progress_bar

    if values["options"] is not None:
        stated_fields = _add_fields_of_file(values["options"], kind.options, stated_fields)
    if values.get("run") is not None:
        sources = [read_or_identify_run(Path(sources[0]), values["run"]), *sources[1:]]
    fields = _state_units(kind, stated_fields)
    do_work = getattr(Here(), ROOMS[kind.name].command)  # the method with the name of the command
    has_progress = kind.stepped or "campaigns" in kind.sources
    with naming_options(kind.options), progress_bar(shown=has_progress) as show_progress:
        on_progress = show_progress if has_progress else None
        job: Job = do_work(*sources, on_progress=on_progress, **fields)
    return job


def _add_fields_of_file(
    file: Path, message_class: type[Message], stated_fields: dict[str, Any]
) -> dict[str, Any]:
    """Return the fields of a file of options with those of the command, which take precedence.

    Raises:
        CampaignError: the file cannot be read.
        typer.BadParameter: a field of the command cannot be converted to the units of the file.
    """
    from jointstiff.service.resources.documents import read_object

    options = read_object(file)
    # As a message, whose fields are in SI units whatever the units of the file
    if "cut" in message_class.model_fields and isinstance(options.get("cut"), dict):
        options["cut"] = Cut.model_validate(options["cut"])
    return options | _convert_to_units_of_file(options, message_class, stated_fields)


def _state_units(kind: AnyKind, fields: dict[str, Any]) -> dict[str, Any]:
    """Return the fields with the units to which options are parsed, unless a file of options states units.

    Readings of geometry state their own units in their file.
    """
    if "units" not in kind.options.model_fields:
        return {"units": "m, rad, N, N.m"} | fields
    return {"units": "mm, deg, N, N.m"} | fields if kind.is_form else fields


def _convert_to_units_of_file(
    file_content: dict[str, Any], message_class: type[Message], stated_fields: dict[str, Any]
) -> dict[str, Any]:
    """Return the values of a command's options, converted to the units that a file of options states.

    With `{"units": {"length": "m"}}` in the file: an option of 200 mm → 0.2.

    Args:
        file_content: content of the file of options; its `units` hold for all fields.
        message_class: class of the message that has the fields.
        stated_fields: fields that options of the command state, in mm, deg and N.

    Raises:
        typer.BadParameter: a posture has more than six joints, so it contains linear axes, and the file
            states angles in another unit than deg.
    """
    from jointstiff.service.conversion.units import ANGLE, FORCE, LENGTH

    units = file_content.get("units")
    if not isinstance(units, dict):
        return stated_fields
    # Unit of an option → its quantity, and the size of each unit of that quantity in SI units.
    quantities = {"mm": ("length", LENGTH), "deg": ("angle", ANGLE), "N": ("force", FORCE)}
    converted = dict(stated_fields)
    for name, value in stated_fields.items():
        unit_of_option = find_option_form(message_class.model_fields[name]).unit
        if unit_of_option == _FRAME_UNITS and (units.get("length"), units.get("angle")) != ("mm", "deg"):
            raise typer.BadParameter(
                f"is in mm and deg, not in the units of the file of options; remedy: state `{name}` there",
                param_hint=option_flag(message_class, name),
            )
        quantity, unit_sizes = quantities.get(unit_of_option, ("", {}))
        file_unit = units.get(quantity)
        if file_unit not in unit_sizes:
            continue
        if quantity == "angle" and file_unit != "deg":
            _refuse_linear_axes(value, name, str(file_unit), message_class)
        converted[name] = scale_numbers(unit_sizes[unit_of_option] / unit_sizes[file_unit], value)
    return converted


def _refuse_linear_axes(value: object, name: str, file_unit: str, message_class: type[Message]) -> None:
    """Refuse a posture with more joints than an arm has, because a factor of angles would scale linear axes.

    Raises:
        typer.BadParameter: names the option of the field `name`.
    """
    if isinstance(value, list | tuple) and len(value) > _JOINTS_OF_ARM:
        raise typer.BadParameter(
            f"the unit of angles in the file of options is {file_unit}, so values of linear axes in "
            f"deg cannot be converted; remedy: state `{name}` in the file of options, in the units "
            "of this file",
            param_hint=option_flag(message_class, name),
        )


def scale_numbers(factor: float, value: Any) -> Any:  # noqa: ANN401 - JSON
    """Return a number, or all numbers in nested lists and dictionaries, multiplied by a factor."""
    if isinstance(value, dict):
        return {key: scale_numbers(factor, item) for key, item in value.items()}
    return (
        [scale_numbers(factor, item) for item in value] if isinstance(value, list | tuple) else factor * value
    )


def _print_job(kind: AnyKind, job: Any, values: _Values) -> None:  # noqa: ANN401 - a job that shows itself
    """Print a job as a report, JSON or CSV, as the options request.

    Raises:
        typer.Exit: the job has failed.
    """
    if values["as_json"]:
        typer.echo(kind.to_answer(job.model_dump_json(indent=2)))
    elif values.get("as_csv") and job.result is not None:
        typer.echo(job.table("csv").decode(), nl=False)
    else:
        _print_report(kind, job, values)
    if job.state != "succeeded":
        raise typer.Exit(1)


def _print_report(kind: AnyKind, job: Any, values: _Values) -> None:  # noqa: ANN401 - a job that shows itself
    """Print the report of a job; that of a run names the actions of --apply, unless one was just applied."""
    from jointstiff.service.reports.job import lay_out_job
    from jointstiff.service.tables.terminal import console

    if values.get("second") is not None:
        typer.echo(f"First: {values['file']}. Second: {values['second']}.")
    names_actions = kind.name == "run" and _choose_action(values) is None
    shown = lay_out_job(
        kind,
        job,
        details=values["details"],
        unit=values["unit"],
        applies=names_actions,
        change_text=partial(_name_options, kind.options),
    )
    console().print(shown)


def _name_options(options: type[Message], text: str) -> str:
    """Return a text that names options of a command, or those of commands that use its result."""
    return name_options_in_text(AcceptingOptions, name_options_in_text(options, text))


def _choose_corrected_path(values: _Values) -> Path | None:
    """Return the path for the corrected campaign, by default next to the old one; None without an action.

    Raises:
        typer.BadParameter: --output is given without --apply or --payload, or does not end in .json; or
            --payload is given with another action than its own.
    """
    output: Path | None = values["output"]
    action = _choose_action(values)
    if action is None:
        if output is not None:
            message = (
                "names the file for the campaign that --apply or --payload corrects, so one of them is "
                f"needed; `--save {output.with_suffix('.json')}` writes the whole result, "
                "`jointstiff export` writes tables, `jointstiff report` writes reports"
            )
            raise typer.BadParameter(message, param_hint="--output")
        return None
    if output is not None:
        cli.check_ending(output, [".json"])
    file, name = values["file"], action.replace("_", "-")
    return output or file.with_name(f"{file.stem}-{name}{file.suffix}")


def _choose_action(values: _Values) -> str | None:
    """Return the action of --apply; with --payload alone the action that states the payload; else None.

    Raises:
        typer.BadParameter: --payload is given with another action.
    """
    action: str | None = values["apply"]
    if values["payload"] is None:
        return action
    if action not in (None, "state_payload"):
        raise typer.BadParameter(f"belongs to no action {action}: omit it", param_hint="--payload")
    return "state_payload"


def _apply_action(job: Any, values: _Values, _sources: Sequence[Any]) -> Any:  # noqa: ANN401 - runs
    """Apply the action of --apply or --payload; write the corrected campaign, and return its run.

    A table that compares the old and the new run is printed, unless --json is given. Without an action,
    return the old run `job`.
    """
    from jointstiff.service.kinds.run.kind import before_after_table
    from jointstiff.service.tables.stiffness import UNITS
    from jointstiff.service.tables.terminal import console, lay_out_parts

    path = _choose_corrected_path(values)
    if path is None:
        return job
    new_run = job.apply(_choose_action(values), payload=values["payload"])
    document = new_run.campaign.model_dump(mode="json", exclude_none=True, exclude_defaults=True)
    cli.write_json(path, document)
    if new_run.result is not None and not values["as_json"]:
        table = before_after_table(job.result, new_run.result, UNITS[values["unit"]])
        console().print(lay_out_parts([table]))
    return new_run


def _write_robot(job: Any, values: _Values, _sources: Sequence[Any]) -> Any:  # noqa: ANN401 - a Geometry
    """Write the identified robot to the file of --output, if that is given; return the job."""
    if values["output"] is not None:
        robot = job.result.robot.model_dump(mode="json", exclude_none=True)
        cli.write_json(values["output"], robot)
    return job


def _write_paper(job: Any, values: _Values, _sources: Sequence[Any]) -> Any:  # noqa: ANN401 - a Comparison
    """Write the tables and figures of the paper to the file of --paper, if that is given; return the job."""
    path: Path | None = values["paper"]
    if path is None:
        return job
    from jointstiff.service.reports.paper import build_paper
    from jointstiff.service.reports.rendering import render_html, render_pdf

    if path.suffix in {".csv", ".svg"}:
        job.save(path)
    else:
        document = build_paper(job, geometry=_read_geometry(values["geometry"]))
        path.write_bytes(render_pdf(document) if path.suffix == ".pdf" else render_html(document))
    return job


def _read_geometry(path: Path | None) -> Any:  # noqa: ANN401 - a Geometry or None
    """Return the saved geometry in a file, for Table I of the paper; None without a file.

    Raises:
        CampaignError: the file is the result of another kind of work, or has no wrist centre by targets.
    """
    if path is None:
        return None
    from jointstiff.schemas.geometry import Geometry
    from jointstiff.service.library.saved import load
    from jointstiff.service.problems import CampaignError, http_problem
    from jointstiff.service.reports.paper import require_wrist

    geometry = load(path)
    if not isinstance(geometry, Geometry):
        remedy = "give a file that `jointstiff geometry SWEEPS.json --save FILE` wrote"
        raise CampaignError(http_problem(422, f"{path} is not a geometry", remedy))
    require_wrist(geometry)
    return geometry


def _check_paper(values: _Values, _sources: Sequence[Any]) -> Sequence[Path | None]:
    """Return the path of the file of --paper; refuse another ending, a PDF without Typst, or no such file."""
    if values["geometry"] is not None and values["paper"] is None:
        raise typer.BadParameter(
            "applies only to Table I of the option --paper: add --paper", param_hint="--geometry"
        )
    _read_geometry(values["geometry"])
    if values["paper"] is not None:
        cli.check_ending(values["paper"], [".pdf", ".html", ".svg", ".csv"])
        if values["paper"].suffix == ".pdf":
            from jointstiff.service.reports.rendering import require_typst

            require_typst()
    return [values["paper"]]


def _write_campaign_to_fill_in(job: Any, values: _Values, sources: Sequence[Any]) -> Any:  # noqa: ANN401 - a Plan
    """Write a campaign with empty readings to the file of --campaign, if it is given; return the job."""
    from jointstiff.service.kinds.plan.kind import make_campaign_to_fill_in
    from jointstiff.service.resources.documents import read_plan_source

    if values["campaign"] is not None:
        campaign = make_campaign_to_fill_in(read_plan_source(sources[0]), job)
        cli.write_json(values["campaign"], campaign)
    return job


def _choose_program_paths(values: _Values, sources: Sequence[Any]) -> dict[str, Path]:
    """Return name → path to write, for each file of a program, by the path or folder of --output."""
    from jointstiff.service.kinds.correction.files import choose_program_paths

    names = [name for name in _list_names(sources[1]) if name != values["loads"]]
    return choose_program_paths(values["output"], names)


def _correct_table_or_explain_moves(values: _Values, sources: Sequence[Any]) -> bool:
    """Correct a table of poses; or print how each move of a program is understood if --explain is given.

    Return False for a program that is to be corrected.

    Raises:
        typer.BadParameter: neither --explain nor --output is given for a program.
        CampaignError: a file or an option cannot be used.
        typer.Exit: no row of a table is corrected, or the arguments are exchanged.
    """
    from jointstiff.service.resources.documents import read_object

    file, paths = sources
    _refuse_exchanged(Path(file), paths[0], "CAMPAIGN_OR_ROBOT POSES")
    format_ = values["format"] or (
        read_object(values["options"]).get("format") if values["options"] else None
    )
    is_program = values["explain"] or len(paths) > 1 or are_programs(_list_names(paths), format_)
    if not is_program:
        _correct_table(file, paths[0], values)
        return True
    if not values["explain"]:
        if values["output"] is None:
            raise typer.BadParameter("is missing: name the file to write", param_hint="--output")
        return False
    rows = _list_moves(values, sources[1])
    if values["as_json"]:
        typer.echo(json.dumps([row._asdict() for row in rows], indent=2))
        return True
    for row in rows:
        typer.echo(_describe_move(row))
    count = sum(row.corrected for row in rows)
    typer.echo(f"{count} of {len(rows)} moves can be corrected, {len(rows) - count} cannot")
    return True


def _list_names(paths: Sequence[Path]) -> list[str]:
    """Return the names of files, without folders."""
    return [path.name for path in paths]


def _list_moves(values: _Values, paths: Sequence[Path]) -> Sequence[Any]:
    """Return how each move of the program in some files is understood, as `robotprograms.ReadMove`.

    Raises:
        CampaignError: the program cannot be read.
    """
    from jointstiff.service.problems import naming_missing_extra

    with naming_missing_extra("a program file"):
        from jointstiff.service.kinds.correction.text import list_moves
    files = [(path.name, path.read_bytes()) for path in paths]
    with naming_options(CorrectionOptions):
        return list_moves(
            files,
            values["format"],
            values["leave_alone"] or (),
            values["external_axes"],
            trust_routines=bool(values["trust_routines"]),
        )


def _describe_move(move: Any) -> str:  # noqa: ANN401 - a `robotprograms.ReadMove`
    """Return a line on a move: "line 7: P3, base 2, tool 1: corrected", or why it is not corrected."""
    verdict = "corrected"
    if not move.corrected:
        remedy = name_options_in_text(CorrectionOptions, f"; {move.remedy}") if move.remedy else ""
        verdict = f"not corrected: {move.reason}{remedy}"
    frames = f"base {move.base or 'unknown'}, tool {move.tool or 'unknown'}"
    return f"line {move.line}: {move.target or 'target unknown'}, {frames}: {verdict}"


def _write_program_files(job: Any, values: _Values, sources: Sequence[Any]) -> Any:  # noqa: ANN401 - a CorrectionJob
    """Write the corrected files of a program, and the table of points if `--report` names a file.

    Return the job.
    """
    from jointstiff.service.kinds.correction.files import decompress_file

    paths = _choose_program_paths(values, sources)
    for file in job.result.program.files:
        paths[file.name].write_bytes(decompress_file(file))
    if values["report"] is not None:
        values["report"].write_bytes(job.table("csv"))
    return job


def _make_optional_parameter(option: Any, kind: type = Path) -> tuple[Any, None]:  # noqa: ANN401 - Typer's
    """Return the annotation and the default, None, of an option that may be omitted."""
    return Annotated[kind | None, option], None


_FILE_OPTIONS: Final[Mapping[str, _FileOptions]] = {
    "run": _FileOptions(
        options={
            "apply": _make_optional_parameter(
                typer.Option(
                    metavar="ACTION",
                    help="Apply an action that a reason of the verdict recommends, such as exchange_columns "
                    "or convert_units. The corrected campaign is written to a new file and identified.",
                ),
                str,
            ),
            "payload": _make_optional_parameter(
                typer.Option(
                    metavar="KG",
                    help="State the largest payload by the robot's maker [kg], if the verdict requests it. "
                    "The campaign with this payload is written to a new file and identified.",
                ),
                float,
            ),
            "output": _make_optional_parameter(
                cli.output_option(
                    "File to write the corrected campaign to; default: a new file next to the old one."
                )
            ),
        },
        finish=_apply_action,
        list_paths=lambda values, _: [_choose_corrected_path(values)],
    ),
    "comparison": _FileOptions(
        options={
            "paper": _make_optional_parameter(
                cli.path_option(
                    "File to write the paper's Tables I and II and figures 7 and 8 to: .pdf or .html; .svg "
                    "has the figures, .csv Table II.",
                )
            ),
            "geometry": _make_optional_parameter(
                cli.file_option("Result of `jointstiff geometry --save`, for Table I of --paper.")
            ),
        },
        finish=_write_paper,
        list_paths=_check_paper,
    ),
    "gearbox": _FileOptions(options={"robot": (cli.NamedRobot, None)}, passed_options=("robot",)),
    "geometry": _FileOptions(
        options={
            "robot": (cli.NamedRobot, None),
            "output": _make_optional_parameter(
                cli.output_option("File to write the identified robot to.", "ROBOT.json")
            ),
        },
        endings=(".json",),
        passed_options=("robot",),
        finish=_write_robot,
        list_paths=lambda values, _: [values["output"]],
    ),
    "plan": _FileOptions(
        options={
            "campaign": _make_optional_parameter(
                cli.path_option("File to write a campaign with empty readings to.")
            )
        },
        finish=_write_campaign_to_fill_in,
        list_paths=lambda values, _: [values["campaign"]],
    ),
    "correction": _FileOptions(
        options={
            "output": _make_optional_parameter(
                cli.output_option(
                    "File for the rows, .csv or .parquet; or for the corrected program, with its .dat next "
                    "to it; in a folder, files of a program keep their names."
                )
            ),
            "explain": (
                Annotated[
                    bool,
                    typer.Option(
                        "--explain",
                        help="Only print the target, base and tool of each move of a program, and the reason "
                        "why a move is not corrected.",
                    ),
                ],
                False,
            ),
            "report": _make_optional_parameter(cli.path_option("CSV file to write a program's points to.")),
        },
        finish=_write_program_files,
        replace_work=_correct_table_or_explain_moves,
        list_paths=lambda values, sources: [
            *_choose_program_paths(values, sources).values(),
            values["report"],
        ],
    ),
}
