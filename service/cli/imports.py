"""`jointstiff import`: files of readings shown as understood, asked about, then written as a campaign."""

from __future__ import annotations

import csv
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final

import typer

from jointstiff.schemas.fields import Terminal
from jointstiff.schemas.imports import FilePreview, ImportAnswer, ImportRequest
from jointstiff.schemas.measurement import SetMetadata
from jointstiff.service.cli import options as cli
from jointstiff.service.cli.kinds import (
    field_options,
    flag_of,
    gathered,
    in_options,
    times,
    worded,
)

if TYPE_CHECKING:
    from jointstiff.schemas.imports import Delimiter
    from jointstiff.schemas.robot import RobotDocument
    from jointstiff.service.importing.reading import SourceFile
    from jointstiff.service.tables.table import Line, Part


Options = dict[str, Any]
"""Fields of the request of an import."""
_LONGEST: Final = 24
_LINES_SHOWN: Final = 8
_STATES: Final = ("unloaded", "loaded", "deflection")
_CHOICES: Final[Mapping[str, tuple[str, tuple[str, ...], str | None]]] = {
    "units.length": ("Unit of lengths", ("m", "mm", "in"), "mm"),
    "units.angle": ("Unit of angles", ("rad", "deg"), "deg"),
    "units.force": ("Unit of forces", ("N", "kN", "kgf"), "N"),
    "units.moment": ("Unit of moments", ("N.m", "N.mm", "kN.m", "kgf.m"), "N.m"),
    "delimiter": ("Delimiter between cells", ("comma", "semicolon", "tab", "whitespace"), None),
    "decimal_mark": ("Decimal mark", ("point", "comma"), None),
    "state": ("State of the positions", _STATES, None),
    "encoders": ("Encoders that close the position loop", ("motor", "secondary"), "motor"),
}
"""Text, answers and default; without a default where a wrong one would read other numbers."""


def _parse_pair(text: str) -> tuple[str, str]:
    """Return `KEY=VALUE` as both; a key may contain `=`."""
    key, equals, value = text.rpartition("=")
    if not equals:
        raise ValueError(f"'{text}' has no '='")
    return key.strip(), value.strip()


def _target(text: str) -> tuple[str, tuple[float, ...]]:
    target, place = _parse_pair(text)
    return target, cli.vector_of(place)


def _split_header(text: str, delimiter: Delimiter | None) -> list[str]:
    """Split a header by its file's delimiter; where it has none of those, by semicolons, tabs or commas.

    A header without any of these signs is split by blanks.
    """
    from jointstiff.service.importing.grid import CHARACTERS

    signs = ([] if delimiter is None else [CHARACTERS[delimiter]]) + [*";\t,"]
    sign = next((sign for sign in signs if sign in text.strip()), " ")
    if sign == " ":
        text = " ".join(text.split())
    row = next(csv.reader([text], delimiter=sign, skipinitialspace=True), [])
    return [cell.strip() for cell in row]


_FORMS: Final = {
    "units": Terminal(
        "",
        "length=mm,angle=deg,force=N",
        lambda text: dict(_parse_pair(part) for part in text.split(",") if part),
        text="Units of columns whose header has none; add moment=N.m if there are moments.",
    ),
    "columns": Terminal("--column", "HEADER=MEANING", _parse_pair, "dict"),
    "ignore": Terminal("", "HEADER", str, "list"),
    "point_name": Terminal("", "TEMPLATE", str),
    "file_name": Terminal("", "TEMPLATE", str),
    "state_words": Terminal("--state-word", "WORD=STATE", _parse_pair, "dict"),
    "header": Terminal("", "'A;B;C'", str),
    "noise": Terminal(
        "--sigma",
        "MM",
        lambda text: {"sigma": float(text)},
        text="Standard uncertainty of a coordinate, in mm.",
    ),
    "load_point": Terminal(
        "", "X,Y,Z[mm]", cli.vector_of, text="Point where the force acts, in the flange frame, in mm."
    ),
    "force": Terminal(
        "",
        "X,Y,Z[force]",
        cli.vector_of,
        text="Force in every observation, axes of R0, in the unit of --units force=…, if no column has it.",
    ),
    "flange_targets": Terminal(
        "--flange-target",
        "TARGET=X,Y,Z[mm]",
        _target,
        "dict",
        text="Target's position in the flange frame, in mm, for deflections.",
    ),
    **dict.fromkeys(("layouts", "length_unit", "robot_id", "show_faults"), Terminal(hidden=True)),
}
"""Forms of the fields of an import on the command line; those that are hidden have no option."""
_LENGTHS: Final = frozenset(("noise", "load_point", "flange_targets"))
"""Fields that are typed in mm."""

_OPTIONS: Final[Mapping[str, tuple[Any, Any]]] = {
    "robot": (cli.NamedRobot, None),
    "about": (
        Annotated[
            list[str] | None,
            typer.Option(
                metavar="KEY=VALUE",
                help="Note about the set: measured_at, serial_number, item_condition, operator, instrument, "
                "conditions or notes. Repeatable.",
            ),
        ],
        None,
    ),
    "output": (
        Annotated[
            Path | None,
            cli.output_option(
                "File to write: a campaign; without --robot a measurement set; poses for `geometry` if only "
                "unloaded positions were read, and the robot has no masses."
            ),
        ],
        None,
    ),
    "template": (
        Annotated[
            Path | None, cli.file_option("Template of an earlier import; files of another form are refused.")
        ],
        None,
    ),
    "save_template": (
        Annotated[Path | None, cli.path_option("Write the template of this import.")],
        None,
    ),
    "overwrite": (cli.Overwrite, False),
    "despite_errors": (
        Annotated[
            bool,
            typer.Option("--despite-errors", help="Write readings although their inspection finds errors."),
        ],
        False,
    ),
    "as_json": (cli.AsJson, False),
}


def import_command() -> Callable[..., None]:
    """Return the command, with an option for each field of the request."""

    def command(files: list[Path], **values: Any) -> None:  # noqa: ANN401 - by the signature below
        """Import files of readings as a campaign.

        Nothing is written without --output or --save-template, nor while something is missing. At a terminal
        it asks for what is missing. If the inspection of the readings finds errors, they are written only
        with --despite-errors, and the exit status is 1 without it.
        """
        if values["output"] is not None:
            cli.check_ending(values["output"], [".json"])
        _import(files, gathered(ImportRequest, values, _FORMS), values)

    fields = {name: (one, None) for name, one in field_options(ImportRequest, _FORMS)}
    taken = Annotated[
        list[Path], cli.file_argument("FILES...", "Files of tables or point lists: text or Excel.")
    ]
    cli.with_signature(command, {"files": (taken, ...), **fields, **_OPTIONS})
    return command


def _import(files: Sequence[Path], chosen: Options, values: Mapping[str, Any]) -> None:
    from jointstiff.service.resources.documents import read_robot

    notes = _parse_notes(values["about"] or [])
    known = {} if values["template"] is None else _read_template(values["template"])
    stated = _merge_options(known, _with_length_unit(chosen, known))
    asking = may_ask() and not values["as_json"]
    robot = None if values["robot"] is None else read_robot(values["robot"])
    answer, stated = _read_and_ask(files, stated, robot, asking=asking)
    if robot is None and asking and answer.measurement_set is not None and (named := ask_robot()):
        robot = read_robot(named)
        answer, _ = _read_and_ask(files, stated, robot, asking=False)
    if robot is not None and answer.bodies:
        robot = robot.model_copy(update={"bodies": answer.bodies})
    if answer.measurement_set is not None:
        noted = answer.measurement_set.model_copy(update=notes)
        answer = answer.model_copy(update={"measurement_set": noted})
    _show(answer, as_json=values["as_json"])
    if values["save_template"] is not None:
        _write_template(values["save_template"], answer, overwrite=values["overwrite"])
    if has_errors(answer) and not values["despite_errors"]:
        if values["output"] is not None:
            cli.warn(f"{values['output']} was not written: correct the errors, or use --despite-errors")
        raise typer.Exit(1)
    if values["output"] is not None:
        _write_campaign(values["output"], answer, robot, overwrite=values["overwrite"])


def _show(answer: ImportAnswer, *, as_json: bool) -> None:
    from jointstiff.service.tables.terminal import console, printed

    if as_json:
        typer.echo(answer.model_dump_json(indent=2))
    else:
        console().print(printed(import_report(answer)))


def _merge_options(options: Options, others: Options) -> Options:
    """Return options with others over them; of dictionaries, such as units, entry by entry."""
    merged = dict(options)
    for field, value in others.items():
        before = merged.get(field)
        merged[field] = before | value if isinstance(before, dict) and isinstance(value, dict) else value
    return merged


def _with_length_unit(stated: Options, template: Options) -> Options:
    """Return options with their lengths, which are in mm, in the unit of a template's lengths."""
    lengths = {name: value for name, value in stated.items() if name in _LENGTHS}
    if not lengths:
        return stated
    unit = template.get("length_unit", "mm")
    if unit == "m":
        lengths = times(1e-3, lengths)
    return {**stated, **lengths, "length_unit": "m" if unit == "m" else "mm"}


def _read_and_ask(
    files: Sequence[Path], stated: Options, robot: RobotDocument | None, *, asking: bool
) -> tuple[ImportAnswer, Options]:
    """Return what the files say, in words of options, and all options with those that a person answers."""
    from jointstiff.service.resources.documents import parse_document
    from jointstiff.service.resources.imports import import_files

    sources, known, measured = _read(files), set[str](), None
    with _as_options():
        if robot is not None:
            from jointstiff.service.conversion.prepared import prepare_robot  # with numerics

            measured = prepare_robot(robot).robot
        while asking:
            request = parse_document(_with_cells(stated, sources) | {"show_faults": True}, ImportRequest)
            given = ask(import_files(sources, request, measured), known)
            if not given:
                break
            stated = _merge_options(stated, _with_length_unit(given, stated))
        request = parse_document(_with_cells(stated, sources), ImportRequest)
        answer = import_files(sources, request, measured)
    findings = answer.findings and [
        finding.model_copy(update={"remedy": _in_option_names(finding.remedy)}) for finding in answer.findings
    ]
    missing = [_in_option_names(text) for text in answer.missing]
    return answer.model_copy(update={"missing": missing, "findings": findings}), stated


def _with_cells(stated: Options, sources: Sequence[SourceFile]) -> Options:
    """Return options with the cells of a header that was typed as one text."""
    from jointstiff.service.importing.reading import delimiter_of

    if not isinstance(header := stated.get("header"), str):
        return stated
    found: Delimiter | None = next(filter(None, map(delimiter_of, sources)), None)
    delimiter: Delimiter | None = stated.get("delimiter") or found
    return {**stated, "header": _split_header(header, delimiter)}


@contextmanager
def _as_options() -> Iterator[None]:
    """Name options in place of fields where files or options are refused."""
    from jointstiff.service.problems import CampaignError, FilesError, problem_of

    try:
        yield
    except FilesError as error:
        raise CampaignError(in_options(ImportRequest, problem_of(error), _FORMS)) from error
    except CampaignError as error:
        problem = in_options(ImportRequest, error.problem, _FORMS)
        where = problem.where or ""
        name, _, rest = where.partition(".")
        if name in ImportRequest.model_fields:
            place = f"{flag_of(ImportRequest, name, _FORMS)} {rest}".rstrip()
            changes = {"where": place, "detail": problem.detail.replace(where, place)}
            problem = problem.model_copy(update=changes)
        raise CampaignError(problem) from None


def _in_option_names(text: str) -> str:
    return worded(ImportRequest, text, _FORMS)


def _read(files: Sequence[Path]) -> list[SourceFile]:
    """Return the files, no more of them than an import takes."""
    from jointstiff.service.importing.grid import MAX_FILE_BYTES
    from jointstiff.service.importing.reading import SourceFile

    sources, left = [], MAX_FILE_BYTES
    for path in files:
        with path.open("rb") as file:
            content = file.read(left + 1)
        left = max(0, left - len(content))
        sources.append(SourceFile(path.name, content))
    return sources


def _parse_notes(texts: Sequence[str]) -> dict[str, Any]:
    """Return what `--about KEY=VALUE` says of a set.

    Raises:
        CampaignError: a key or a value is none.
    """
    from jointstiff.service.problems import CampaignError
    from jointstiff.service.resources.documents import parse_document

    pairs = (text.partition("=") for text in texts)
    try:
        notes = parse_document({key.strip(): value.strip() for key, _, value in pairs}, SetMetadata)
    except CampaignError as error:
        where = f"--about.{error.problem.where}"
        raise CampaignError(error.problem.model_copy(update={"where": where})) from None
    return {name: getattr(notes, name) for name in notes.model_fields_set}


def _read_template(path: Path) -> Options:
    from jointstiff.service.resources.documents import read_document

    known: Options = read_document(path, ImportRequest).model_dump(mode="json", exclude_defaults=True)
    if "length_unit" not in known and (known.get("units") or {}).get("length") == "m":
        known["length_unit"] = "m"  # lengths of a template without it are in the files' unit
    return known


def _write_template(path: Path, answer: ImportAnswer, *, overwrite: bool) -> None:
    """Write the template of an import.

    Raises:
        typer.Exit: something is missing, or the file cannot be written.
    """
    if answer.template is None:
        if not answer.missing:
            reason = "no template was written: the files have too many columns, or too long headers"
            raise cli.failed(reason, "ignore columns that are not needed, in smaller files")
        raise cli.failed(f"no template was written: {'; '.join(answer.missing)} missing", "add it")
    cli.refuse_existing(path, overwrite=overwrite)
    template = answer.template.model_dump(mode="json", exclude_defaults=True)
    cli.write_json(path, template)


def _write_campaign(
    path: Path, answer: ImportAnswer, robot: RobotDocument | None, *, overwrite: bool
) -> None:
    """Write a campaign, or without a robot the measurement set; unloaded poses if the files have no more.

    Raises:
        typer.Exit: something is missing, or the file cannot be written.
    """
    from jointstiff.service.problems import http_problem

    readings = answer.measurement_set or answer.geometry
    if readings is None:
        missing = "; ".join(answer.missing)
        raise cli.refused(
            http_problem(422, f"nothing was written, because this is missing: {missing}", "add it")
        )
    cli.refuse_existing(path, overwrite=overwrite)
    document = readings.model_dump(mode="json", exclude_none=True, exclude_unset=readings is answer.geometry)
    robot_part = {} if robot is None else {"robot": robot.model_dump(mode="json", exclude_unset=True)}
    if answer.measurement_set is None:
        document |= robot_part
        robots = "" if robot_part else " --robot ROBOT"
        what, command = "unloaded poses", f"jointstiff geometry {path}{robots}"
    elif robot_part:
        document = {**robot_part, "measurement_set": document}
        if answer.leave_out:
            document["run"] = {"leave_out": answer.leave_out}
        if answer.geometry is not None:
            document["run"] = {**document.get("run", {}), "weight": {}}
        what, command = "a campaign", f"jointstiff identify {path}"
    else:
        what, command = "a measurement set", "add a robot with --robot"
    cli.write_json(path, document)
    typer.echo(f"wrote {path}, {what}; now: {command}", err=True)


def may_ask() -> bool:
    """Return whether a person is there to answer."""
    return sys.stdin.isatty()


def ask(answer: ImportAnswer, known: set[str]) -> Options:
    """Ask for what is missing in an answer.

    Args:
        answer: with faults and missing fields.
        known: options that a question was about before, which is not repeated; extended.

    Returns:
        The options of the API that were answered; empty if nothing remains to be asked.
    """
    given: Options = {}
    faults = [fault.option for fault in answer.faults if fault.option is not None]
    for option in dict.fromkeys([*faults, *answer.missing_fields]):
        for name, question in _questions(option, answer):
            if name not in known:
                if not known:
                    typer.echo(_HOW_TO_ANSWER, err=True)
                known.add(name)
                value = question()
                key, _, inner = name.partition(".")
                if inner:
                    given.setdefault(key, {})[inner] = value
                else:
                    given[key] = value
    return given


def ask_robot() -> str | None:
    """Ask for the robot: its file, or the name of an arm of the catalogue."""
    text: str = typer.prompt(
        "Measured robot, for the integrity checks: file or arm", default="none", err=True
    )
    return None if text == "none" else text


_HOW_TO_ANSWER: Final = (
    "Enter alone takes the answer in brackets; a question without one is asked until it is answered."
)


def _questions(option: str, answer: ImportAnswer) -> Iterator[tuple[str, Callable[[], object]]]:
    """Yield name and question of each option that settles something."""
    if option in _QUESTIONS:
        yield option, _QUESTIONS[option]
    elif option == "flange_targets":
        for target in answer.targets:
            text = f"{target} in the flange frame, X,Y,Z in mm"
            yield f"flange_targets.{target}", partial(_vector, text, None)
    elif option == "state_words":
        yield from _ask_states(next(fault.words for fault in answer.faults if fault.option == option))
    elif option == "accept_unusual":
        doubtful = answer.missing[answer.missing_fields.index("accept_unusual")].partition("right: ")[2]
        yield option, partial(typer.confirm, f"Is this right: {doubtful}?", default=False, err=True)
    elif option == "columns":
        columns = (column for file in answer.files for column in file.columns)
        for header in dict.fromkeys(column.header for column in columns if column.meaning == "unknown"):
            text = f"Meaning of column {header!r}, such as J1 [deg]"
            yield f"columns.{header}", partial(typer.prompt, text, default="ignore", err=True)


def _prompt_choice(text: str, choices: tuple[str, ...], default: str | None) -> str:
    def checked(value: str) -> str:
        if value not in choices:
            raise typer.BadParameter(f"answer {', '.join(choices)}")
        return value

    answer: str = typer.prompt(
        f"{text} ({', '.join(choices)})", default=default, value_proc=checked, err=True
    )
    return answer


def _ask_states(words: Sequence[str]) -> Iterator[tuple[str, Callable[[], object]]]:
    """Ask which of two words is without load, or what one word means."""
    if len(words) > 1:

        def both() -> dict[str, str]:
            unloaded = _prompt_choice("Word for readings without load", tuple(words), words[0])
            return {word: "unloaded" if word == unloaded else "loaded" for word in words}

        yield "state_words", both
    for word in words if len(words) == 1 else ():
        yield f"state_words.{word}", partial(_prompt_choice, f"State that {word!r} means", _STATES, None)


def _vector(text: str, default: str | None) -> tuple[float, ...]:
    answer: tuple[float, ...] = typer.prompt(text, default=default, value_proc=cli.vector_of, err=True)
    return answer


_QUESTIONS: Final[Mapping[str, Callable[[], object]]] = {
    **{option: partial(_prompt_choice, *question) for option, question in _CHOICES.items()},
    "load_point": partial(
        _vector, "Load point in the flange frame, X,Y,Z in mm (at the flange: 0,0,0)", None
    ),
    "force": partial(_vector, "Force on the robot in R0, X,Y,Z", None),
    "by_order": partial(typer.confirm, "Number the rows of files without names?", default=False, err=True),
    "allow_missing": partial(typer.confirm, "Skip incomplete readings?", default=False, err=True),
    "sheet": partial(typer.prompt, "Sheet", err=True),
    "point_name": partial(
        typer.prompt, "Template of point names, such as {label}_{target}_{state}", err=True
    ),
}


def has_errors(answer: ImportAnswer) -> bool:
    """Return whether the inspection of the readings finds errors."""
    return any(finding.weight == "do_not_use" for finding in answer.findings or ())


def import_report(answer: ImportAnswer) -> list[Part]:
    """Return each file with its columns, then all of them together, then what is missing."""
    from jointstiff.service.tables.table import Line, text_table

    parts: list[Part] = []
    for file in answer.files:
        rows = [
            [
                str(column.column),
                _shorten(column.header),
                _shorten(column.meaning) + (" ?" if column.guessed else ""),
                column.unit or "",
                "; ".join(
                    _shorten(row[column.column - 1])
                    for row in file.first_rows[:2]
                    if column.column <= len(row)
                ),
            ]
            for column in file.columns
        ]
        head = ["", "header", "read as", "unit", "first values"]
        parts += [Line(f"{file.file}: {_dialect(file)}", "title"), text_table(head, rows, texts=[1, 2, 3, 4])]
        parts += _lines(file.assumptions, "assumed: ")
    joints = "no joint angles" if answer.joint_count is None else f"{answer.joint_count} joints"
    targets, states = ", ".join(answer.targets) or "none", ", ".join(answer.states) or "none"
    more = ", …" if answer.observation_count > len(answer.first_labels) else ""
    counted = (
        f"  {answer.observation_count} observations ({', '.join(answer.first_labels)}{more}), {joints}, "
        f"{answer.reading_count} complete readings; targets: {targets}; states: {states}"
    )
    parts += [Line(counted), *_lines(answer.assumptions, "assumed: ")]
    if answer.geometry is not None and answer.measurement_set is None:
        parts.append(
            Line(f"  complete: {len(answer.geometry.poses or ())} unloaded poses for a geometry", "good")
        )
    if answer.bodies:
        total = sum(body.mass for body in answer.bodies)
        parts.append(Line(f"  masses: {len(answer.bodies)} bodies, {total:g} kg together"))
    if answer.missing:
        parts += _lines(answer.missing, "missing: ", "care")
    elif not has_errors(answer):
        own = "" if answer.geometry is None else " for the robot's own weight"
        parts.append(Line(f"  complete: a measurement set{own}", "good"))
    return [*parts, *_findings(answer)]


def _findings(answer: ImportAnswer) -> Iterator[Line]:
    """Yield the integrity findings, if a robot is known."""
    from jointstiff.service.tables.report import VERDICTS
    from jointstiff.service.tables.table import Line

    if answer.findings == []:
        yield Line("  integrity: nothing suspicious", "good")
    for finding in answer.findings or ():
        place = f"{finding.observation}: " if finding.observation else ""
        remedy = f"; {finding.remedy}" if finding.remedy else ""
        if finding.action is not None and finding.action.kind == "choose_robot":
            remedy += f" with `--robot '{finding.action.robot}'`"
        style: Any = "bad" if finding.weight == "do_not_use" else "care"
        weight = "for information" if finding.weight == "use" else VERDICTS[finding.weight]
        yield Line(f"  {weight}: {place}{finding.message}{remedy}", style)


def _dialect(file: FilePreview) -> str:
    """Describe the file's format."""
    rows = f"{file.row_count} row{'s' if file.row_count != 1 else ''}"
    if file.format == "xlsx":
        return f"Excel, sheet {file.sheet!r}, {rows}"
    return f"{file.encoding}, {file.delimiter} between cells, decimal {file.decimal_mark}, {rows}"


def _lines(texts: list[str], lead: str, style: Any = "dim") -> Iterator[Line]:  # noqa: ANN401 - a style
    from jointstiff.service.tables.table import Line

    for text in texts[:_LINES_SHOWN]:
        yield Line(f"  {lead}{text}", style)
    if len(texts) > _LINES_SHOWN:
        yield Line(f"  {lead}{len(texts) - _LINES_SHOWN} more (--json shows all)", style)


def _shorten(text: str) -> str:
    printable = "".join(character if character.isprintable() else "\ufffd" for character in text)
    return printable if len(printable) <= _LONGEST else printable[: _LONGEST - 1] + "…"
