"""The command `jointstiff import`: read files of readings, show a preview, ask for what is missing, write."""

from __future__ import annotations

import csv
import re
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Annotated, Any, Final, NamedTuple

import typer

from jointstiff.schemas.fields import Message, Terminal
from jointstiff.schemas.imports import FilePreview, ImportAnswer, ImportFault, ImportRequest
from jointstiff.schemas.measurement import Grounds, MeasurementSetDocument, Noise, SetMetadata
from jointstiff.service.cli import options as cli
from jointstiff.service.cli.failures import print_problem
from jointstiff.service.cli.fields import (
    field_options,
    gather_stated_fields,
    name_options_in_text,
    naming_options,
    option_flag,
)
from jointstiff.service.cli.kinds import scale_numbers

if TYPE_CHECKING:
    from jointstiff.schemas.imports import Delimiter
    from jointstiff.schemas.meaning import TableMeaning
    from jointstiff.schemas.robot import RobotDocument
    from jointstiff.service.importing.source_files import SourceFile
    from jointstiff.service.proposals.proposed_import import NoProposal, ProposedImport
    from jointstiff.service.resources.imports import ForceHints
    from jointstiff.service.tables.table import Line, Part, Table
    from jointstiff.solver.mechanics.robot import KnownRobot, Robot


Options = dict[str, Any]
"""Fields of the request of an import."""
_MAX_CELL_LENGTH: Final = 24
_MAX_LINES: Final = 8
_MAX_FORCE_LENGTH: Final = 100
"""Characters of a typed force."""
_STATES: Final = ("unloaded", "loaded", "deflection")
"""States that the positions of a file can have."""
_CHOICE_QUESTIONS: Final[Mapping[str, tuple[str, tuple[str, ...], str | None]]] = {
    "units.length": ("Unit of lengths", ("m", "mm", "in"), "mm"),
    "units.angle": ("Unit of angles", ("rad", "deg"), "deg"),
    "units.force": ("Unit of forces", ("N", "daN", "kN", "kgf", "lbf"), "N"),
    "units.moment": ("Unit of moments", ("N.m", "N.mm", "kN.m", "kgf.m", "lbf.ft", "lbf.in"), "N.m"),
    "delimiter": ("Delimiter between cells", ("comma", "semicolon", "tab", "whitespace"), None),
    "decimal_mark": ("Decimal mark", ("point", "comma"), None),
    "state": ("State of the positions", _STATES, None),
    "encoders": ("Encoders that close the position loop", ("motor", "secondary"), "motor"),
}
"""Field of the request → (question, possible answers, default answer).

The default is None where a wrong guess could change numbers: then the person must answer.
"""

_GROUND_QUESTIONS: Final[Mapping[str, tuple[str, tuple[str, ...]]]] = {
    "load_point": ("How the load point is known", ("tracker", "drawing", "hand")),
    "force": ("What the force is known by", ("scales", "cell", "pulley", "catalogue")),
    "tared": ("Whether the load cell was tared before each reading", ("true", "false")),
    "between": (
        "What the controller did between the readings without and under load",
        ("still", "payload_declared", "gravity_compensated"),
    ),
}
"""Field of `Grounds` → (question, possible answers); a person who does not know presses Enter."""
_TRUTHS: Final[Mapping[str, bool]] = {"true": True, "false": False}
"""Answer to a question that is true or false → its value."""
_NOT_KNOWN: Final = "unknown"
"""Answer that states nothing, so that the assumptions remain."""


def _parse_pair(text: str, example: str = "A1=J1 [deg]") -> tuple[str, str]:
    """Split the text `KEY=VALUE` at its last `=` into (key, value); an error shows the example.

    Raises:
        ValueError: the text has no `=`.
    """
    key, separator, value = text.rpartition("=")
    if not separator:
        raise ValueError(f"'{text}' must be a name and a value with '=' between them, such as {example}")
    return key.strip(), value.strip()


def _parse_flange_target(text: str) -> tuple[str, tuple[float, ...]]:
    """Parse the text `TARGET=X,Y,Z` into the name of a target and its position in the flange frame [mm]."""
    target, place = _parse_pair(text, "P1=0,0,120")
    return target, cli.parse_vector(place)


def _split_header(text: str, delimiter: Delimiter | None) -> list[str]:
    """Split the text of a header into its cells.

    The text is split at the first of these separators that it contains: the file's delimiter, semicolon,
    tab, comma. A text without any of them is split at blanks.
    """
    from jointstiff.service.importing.grid import CHARACTERS

    separators = ([] if delimiter is None else [CHARACTERS[delimiter]]) + [*";\t,"]
    separator = next((each for each in separators if each in text.strip()), " ")
    if separator == " ":
        text = " ".join(text.split())  # several blanks separate two cells like one blank
    row = next(csv.reader([text], delimiter=separator, skipinitialspace=True), [])
    return [cell.strip() for cell in row]


class _TypedForce(NamedTuple):
    """Force in R0 as a person types it."""

    vector: tuple[float, ...]
    unit: str | None  # None if the text has no unit


_FORCE_WITH_UNIT: Final = re.compile(
    r"\[?(?P<numbers>[-+\d.,;\s eE]*\d\.?)\]?\s*\[?(?P<unit>[A-Za-z]{1,4})?\]?"
)
_FORCE_UNITS: Final[Mapping[str, str]] = {
    "n": "N", "dan": "daN", "kn": "kN", "kg": "kgf", "kgf": "kgf", "kp": "kgf", "lbf": "lbf",
}  # fmt: skip


def _parse_force(text: str) -> _TypedForce:
    """Parse a force such as `0,0,-981 N` or `0 0 -981 N`, or a weight such as `100kg` along −z of R0.

    Raises:
        typer.BadParameter: the text is neither three numbers, nor one number with a unit.
    """
    found = _FORCE_WITH_UNIT.fullmatch(text.strip()) if len(text) <= _MAX_FORCE_LENGTH else None
    unit = None if found is None or found["unit"] is None else _FORCE_UNITS.get(found["unit"].casefold())
    is_known = found is not None and (found["unit"] is None or unit is not None)
    try:
        numbers = [float(part) for part in re.split(r"[,;\s]+", found["numbers"].strip())] if found else []
    except ValueError:
        numbers = []
    is_weight = len(numbers) == 1 and unit is not None
    if not is_known or not (len(numbers) == len("XYZ") or is_weight):
        raise typer.BadParameter(
            f"'{text}' must be three numbers with their unit N, daN, kN, kgf or lbf, such as 0,0,-981N, or a "
            "hung weight such as 100kg"
        )
    return _TypedForce((0.0, 0.0, -abs(numbers[0])) if is_weight else tuple(numbers), unit)


def _split_force(options: Options) -> Options:
    """Return options in which a typed force is three numbers, and its unit that of `units`.

    Raises:
        typer.BadParameter: `--units` states another unit of forces.
    """
    force = options.get("force")
    if not isinstance(force, _TypedForce):
        return options
    units = options.get("units") or {}
    if force.unit is None:
        return {**options, "force": force.vector}
    if units.get("force") not in (None, force.unit):
        reason = f"is in {force.unit}, but --units has force={units['force']}"
        raise typer.BadParameter(reason, param_hint="--force")
    return {**options, "force": force.vector, "units": {**units, "force": force.unit}}


_FORMS: Final = {
    "units": Terminal(
        "",
        "length=mm,angle=deg,force=N",
        lambda text: dict(_parse_pair(part, "length=mm") for part in text.split(",") if part),
        text="Units of columns whose header has no unit; add moment=N.m if there are moments.",
    ),
    "columns": Terminal("--column", "HEADER=MEANING", _parse_pair, "dict"),
    "ignore": Terminal("", "HEADER", str, "list"),
    "point_name": Terminal("", "TEMPLATE", str),
    "file_name": Terminal("", "TEMPLATE", str),
    "state_words": Terminal(
        "--state-word", "WORD=STATE", lambda text: _parse_pair(text, "pre=unloaded"), "dict"
    ),
    "header": Terminal("", "'A;B;C'", str),
    "noise": Terminal(
        "--sigma",
        "MM",
        lambda text: {"sigma": float(text)},
        text="Standard uncertainty of a coordinate, in mm.",
    ),
    "load_point": Terminal(
        "",
        "X,Y,Z[mm]",
        partial(cli.parse_vector, unit="mm"),
        text="Point where the force acts, in the flange frame, in mm.",
    ),
    "force": Terminal(
        "",
        "X,Y,Z[force]",
        _parse_force,
        text="Force in every observation, axes of R0, such as 0,0,-981N, or a hung weight such as "
        "100kg, if no column has forces. Without a unit, that of --units force=… holds.",
    ),
    "flange_targets": Terminal(
        "--flange-target",
        "TARGET=X,Y,Z[mm]",
        _parse_flange_target,
        "dict",
        text="Target's position in the flange frame, in mm, for deflections.",
    ),
    **dict.fromkeys(
        ("layouts", "length_unit", "robot_id", "show_faults", "accept_proposal"), Terminal(hidden=True)
    ),
}
"""Field of `ImportRequest` → its form on the command line; hidden fields have no option.

Fields that are not listed have the form that `ImportRequest` declares.
"""
_PAST_ERRORS: Final = "if the numbers are right, state `--despite-errors` to use the result"
"""How to go past a finding in this command, in place of `PAST_DO_NOT_USE`."""
_UNIT_IN_TEXT: Final = re.compile(r"set `units\.(\w+)` to (\w+)")
"""Remedy that sets one unit of the field `units`: the option `--units` has all units."""
_LENGTH_FIELDS: Final = frozenset(("noise", "load_point", "flange_targets"))
"""Fields whose values are typed in mm on the command line."""

_OTHER_OPTIONS: Final[Mapping[str, tuple[Any, Any]]] = {
    "robot": (cli.NamedRobot, None),
    "payload": (
        Annotated[
            float | None,
            typer.Option(
                metavar="KG",
                help="Largest payload of the robot that its maker states [kg], if the file of the robot "
                "states none.",
            ),
        ],
        None,
    ),
    "about": (
        Annotated[
            list[str] | None,
            typer.Option(
                metavar="KEY=VALUE",
                help="Note about the measurement: measured_at, serial_number, item_condition, operator, "
                "instrument, conditions or notes. Repeatable.",
            ),
        ],
        None,
    ),
    "ground": (
        Annotated[
            list[str] | None,
            typer.Option(
                metavar="KEY=VALUE",
                help="Way in which data of the load were measured. load_point=tracker (1 mm at least), "
                "drawing (3 mm) or hand (10 mm). force=scales, cell, pulley (5 ± 3 % less) or "
                "catalogue (3 %). tared=true or false for a cell. between=still, payload_declared "
                "or gravity_compensated. Repeatable.",
            ),
        ],
        None,
    ),
    "output": (
        Annotated[
            Path | None,
            cli.output_option(
                "File for the campaign, or for a measurement set without --robot. If only unloaded "
                "positions were read and the robot has no masses, the file has poses for `geometry`."
            ),
        ],
        None,
    ),
    "template": (
        Annotated[
            Path | None,
            cli.file_option("Template of an earlier import; files with other headers are refused."),
        ],
        None,
    ),
    "save_template": (
        Annotated[Path | None, cli.path_option("Write the template of this import.")],
        None,
    ),
    "overwrite": (cli.Overwrite, False),
    "yes": (
        Annotated[
            bool,
            typer.Option(
                "--yes",
                help="Accept the meaning of columns that the robot's kinematics proposes where names do not "
                "explain them, and leave out readings that are missing.",
            ),
        ],
        False,
    ),
    "despite_errors": (
        Annotated[
            bool,
            typer.Option(
                "--despite-errors", help="Write the readings even if the integrity checks find errors."
            ),
        ],
        False,
    ),
    "as_json": (cli.AsJson, False),
}


def build_import_command() -> Callable[..., None]:
    """Return the function of the command `import`, with an option for each field of `ImportRequest`."""

    def command(files: list[Path], **values: Any) -> None:  # noqa: ANN401 - the signature set below has the types
        """Import files of readings as a campaign.

        Nothing is written without --output or --save-template, nor while information is missing. At a
        terminal the command asks for the missing information. If the inspection finds errors, the readings
        are written only with --despite-errors, and the exit status is 1 without it.
        """
        if values["output"] is not None:
            cli.check_ending(values["output"], [".json"])
        _run_import(files, gather_stated_fields(ImportRequest, values, _FORMS), values)

    fields = {name: (annotation, None) for name, annotation in field_options(ImportRequest, _FORMS)}
    files_argument = Annotated[
        list[Path], cli.file_argument("FILES...", "Files of tables or point lists: text or Excel.")
    ]
    cli.set_signature(command, {"files": (files_argument, ...), **fields, **_OTHER_OPTIONS})
    return command


def _run_import(files: Sequence[Path], fields: Options, values: Mapping[str, Any]) -> None:
    """Read the files, ask for what is missing, print the preview, and write the files that options name.

    `fields` are the fields of `ImportRequest` that options state, `values` the values of all options.

    Raises:
        typer.Exit: the readings have errors, something is missing, or a file cannot be written.
    """
    from jointstiff.service.importing.source_files import read_sources
    from jointstiff.service.resources.documents import read_robot

    notes = _parse_pairs(values["about"] or [], SetMetadata, "--about")
    grounds = _parse_pairs(values["ground"] or [], Grounds, "--ground", _TRUTHS)
    template_fields, meaning = _read_template(values["template"])
    options = _merge_options(
        template_fields, _convert_to_template_unit(_split_force(fields), template_fields)
    )
    may_ask = is_terminal_input() and not values["as_json"]
    robot = None if values["robot"] is None else read_robot(values["robot"], "--robot")
    stated = _StatedReadings(read_sources(files), options, robot, meaning)
    readings = _complete_readings(stated, may_ask=may_ask, yes=values["yes"])
    imported = _read_with_robot(readings, may_ask=may_ask).show_files(readings.previews)
    imported = imported.add_payload(values["payload"])
    imported = imported.add_notes(notes, grounds, may_ask=may_ask)
    _print_answer(imported.answer, as_json=values["as_json"])
    _write_files(imported, readings, {**values, "files": files})


@dataclass(frozen=True)
class _Imported:
    """Files that were read, and the robot that was measured."""

    answer: ImportAnswer
    robot: RobotDocument | None  # None if the robot is not known

    def show_files(self, previews: Sequence[FilePreview]) -> _Imported:
        """Return the readings with the previews of the files that a proposal explains, if there are any."""
        if not previews:
            return self
        return replace(self, answer=self.answer.model_copy(update={"files": list(previews)}))

    def add_payload(self, payload: float | None) -> _Imported:
        """Return the readings of the robot with a payload [kg], and with the masses that the files state.

        Raises:
            typer.BadParameter: a payload is stated, but the robot is unknown.
            CampaignError: the payload is not plausible.
        """
        robot = _state_payload(self.robot, payload)
        if robot is not None and self.answer.bodies:
            robot = robot.model_copy(update={"bodies": self.answer.bodies})
        return replace(self, robot=robot)

    def add_notes(self, notes: Options, grounds: Options, *, may_ask: bool) -> _Imported:
        """Return the readings with notes about the measurement, and with the grounds of its uncertainties.

        The grounds say how a number is known: `force` by a load cell. With `may_ask`, a person answers for
        grounds that are not stated.
        """
        if self.answer.measurement_set is None:
            return self
        noted_set = self.answer.measurement_set.model_copy(update=notes)
        complete_set = _complete_grounds(noted_set, grounds, may_ask=may_ask)
        return replace(self, answer=self.answer.model_copy(update={"measurement_set": complete_set}))


def _read_with_robot(readings: _StatedReadings, *, may_ask: bool) -> _Imported:
    """Read the files; with `may_ask`, ask a person for the robot.

    With a robot the readings are checked again, because only then the preview has the findings of the
    inspection.
    """
    from jointstiff.service.resources.documents import read_robot

    answer = _read_files(readings)
    asks_for_robot = may_ask and readings.robot is None and answer.measurement_set is not None
    robot_name = ask_for_robot() if asks_for_robot else None
    if not robot_name:
        return _Imported(answer, readings.robot)
    robot = read_robot(robot_name, "--robot")
    return _Imported(_read_files(replace(readings, robot=robot)), robot)


def _write_files(imported: _Imported, readings: _StatedReadings, values: Mapping[str, Any]) -> None:
    """Write the template and the campaign, as far as options name their files.

    Raises:
        typer.Exit: the readings have errors, something is missing, or a file cannot be written.
    """
    answer, output = imported.answer, values["output"]
    refuse_existing = partial(
        cli.refuse_existing, overwrite=values["overwrite"], inputs=cli.list_inputs(values)
    )
    if values["save_template"] is not None:
        template = answer.template and _build_template(answer.template, readings)
        _write_template(values["save_template"], answer, template, refuse_existing)
    if has_blocking_findings(answer) and not values["despite_errors"]:
        if output is not None:
            cli.warn(
                f"{output} was not written: correct the errors, or use --despite-errors"
                f"{_describe_actions(answer, output)}"
            )
        raise typer.Exit(1)
    if output is not None:
        _write_campaign(output, imported, refuse_existing)


def _complete_grounds(
    document: MeasurementSetDocument, grounds: Options, *, may_ask: bool
) -> MeasurementSetDocument:
    """Return a measurement set with its grounds: those of options, then those that a person states.

    Raises:
        typer.BadParameter: the controller knew of the load, so the readings cannot be used.
    """
    from jointstiff.service.conversion.measurements import refuse_informed_controller
    from jointstiff.solver.errors import MeasurementError

    complete_set = _state_grounds(document, grounds)
    if may_ask:
        complete_set = _state_grounds(complete_set, _ask_for_grounds(complete_set))
    try:
        refuse_informed_controller(complete_set.noise)
    except MeasurementError as error:
        raise typer.BadParameter(f"{error.reason}; {error.remedy}", param_hint="--ground") from error
    return complete_set


def _ask_for_grounds(document: MeasurementSetDocument) -> dict[str, Any]:
    """Ask a person how the statements of a campaign are known; return fields of its grounds.

    A question that the campaign answers, or that does not concern it, is not asked.
    """
    is_loaded = any(any(observation.force) for observation in document.observations)
    grounds = None if document.noise is None else document.noise.grounds
    answers = dict[str, Any]()
    for field, (question, choices) in _GROUND_QUESTIONS.items():
        is_read = field == "load_point" and document.load_point_target is not None
        is_answered = is_read or getattr(grounds, field, None) is not None
        force_ground = answers.get("force", getattr(grounds, "force", None))
        is_without_cell = field == "tared" and force_ground != "cell"
        if not is_loaded or is_answered or is_without_cell:
            continue
        answer = _prompt_choice(question, (*choices, _NOT_KNOWN), _NOT_KNOWN)
        if answer != _NOT_KNOWN:
            answers[field] = _TRUTHS.get(answer, answer)
    return answers


def _state_grounds(document: MeasurementSetDocument, grounds: Options) -> MeasurementSetDocument:
    """Return a measurement set with further fields of its grounds."""
    from jointstiff.service.resources.documents import parse_document

    if not grounds:
        return document
    fields = document.noise.model_dump(mode="json", exclude_unset=True) if document.noise else {}
    fields["grounds"] = {**(fields.get("grounds") or {}), **grounds}
    return document.model_copy(update={"noise": parse_document(fields, Noise)})


def _state_payload(robot: RobotDocument | None, payload: float | None) -> RobotDocument | None:
    """Return the robot with a payload [kg]; without a payload, return the robot unchanged.

    Raises:
        typer.BadParameter: the robot is unknown.
        CampaignError: the payload is not plausible.
    """
    from jointstiff.schemas.robot import RobotDocument
    from jointstiff.service.resources.documents import parse_document

    if payload is None:
        return robot
    if robot is None:
        raise typer.BadParameter("needs the robot: add --robot", param_hint="--payload")
    fields = robot.model_dump(mode="json", exclude_unset=True)
    return parse_document({**fields, "payload": payload}, RobotDocument)


def _print_answer(answer: ImportAnswer, *, as_json: bool) -> None:
    """Print the preview of an import, as JSON or as tables for a terminal."""
    from jointstiff.service.tables.terminal import console, lay_out_parts

    if as_json:
        typer.echo(answer.model_dump_json(indent=2))
    else:
        console().print(lay_out_parts(make_import_report(answer)))


def _merge_options(options: Options, others: Options) -> Options:
    """Return the fields of two sets of options; `others` take precedence where both state a field.

    Where both values are dictionaries, the entries of `others` are added to those of `options`.
    """
    merged = dict(options)
    for field, value in others.items():
        earlier_value = merged.get(field)
        are_dictionaries = isinstance(earlier_value, dict) and isinstance(value, dict)
        merged[field] = earlier_value | value if are_dictionaries else value
    return merged


def _convert_to_template_unit(options: Options, template: Options) -> Options:
    """Return options with their lengths, typed in mm, converted to the length unit of a template.

    Options without a length are returned unchanged.
    """
    lengths = {name: value for name, value in options.items() if name in _LENGTH_FIELDS}
    if not lengths:
        return options
    unit = template.get("length_unit", "mm")
    if unit == "m":
        lengths = scale_numbers(1e-3, lengths)
    return {**options, **lengths, "length_unit": "m" if unit == "m" else "mm"}


@dataclass(frozen=True)
class _StatedReadings:
    """Files with what was stated about them."""

    sources: Sequence[SourceFile]
    options: Options
    robot: RobotDocument | None
    meaning: TableMeaning | None = None  # of columns that names do not explain
    previews: Sequence[FilePreview] = ()  # of files that a proposal explains, as they are written
    statements: Options | None = None  # about columns of these files, for a template
    is_refused: bool = False  # whether a person does not accept the robot's proposal
    originals: Sequence[SourceFile] = ()  # files that a proposal explains, as they were sent
    hints: ForceHints | None = None  # of a proposal, on the force of these files

    @property
    def has_proposal(self) -> bool:
        """Answer of a person to a proposal: whether there is one."""
        return self.statements is not None or self.is_refused

    def add_options(self, options: Options) -> _StatedReadings:
        """Return the readings with the answers of a person, whose lengths are in mm."""
        typed = _convert_to_template_unit(options, self.options)
        return replace(self, options=_merge_options(self.options, typed))

    def import_by(self, request: ImportRequest, robot: Robot | None) -> ImportAnswer:
        """Import the files by a request."""
        from jointstiff.service.resources.imports import NO_HINTS, import_files

        hints = NO_HINTS if self.hints is None else self.hints
        return import_files(self.sources, request, robot, originals=self.originals, hints=hints)

    def replace_by_proposal(self, proposed: ProposedImport) -> _StatedReadings:
        """Return the table that a proposal makes of the files, with the robot whose kinematics explains it.

        Options about columns are left out, because the columns of the table are understood.
        """
        from jointstiff.service.proposals.options import OPTIONS_OF_FILES  # imports the messages

        left = proposed.request.model_dump(
            mode="json", include=set(self.options) | {"units", "allow_missing"}
        )
        kept = {name: value for name, value in left.items() if name not in ("columns", "show_faults")}
        robot = self.robot or _read_arm(proposed.known.name)
        statements: Options = {name: self.options[name] for name in OPTIONS_OF_FILES if name in self.options}
        if proposed.request.sheet is not None:
            statements["sheet"] = proposed.request.sheet
        return _StatedReadings(
            proposed.files,
            kept,
            robot,
            proposed.meaning,
            proposed.previews,
            statements,
            originals=proposed.originals,
            hints=proposed.hints,
        )


def _complete_readings(readings: _StatedReadings, *, may_ask: bool, yes: bool) -> _StatedReadings:
    """Return readings whose columns are understood, with the answers of a person to what is missing.

    An answer can lead to a proposal of the robot, so the meaning is looked for again after each round.
    """
    asked_before, reasons = set[str](), set[str]()
    while True:
        if not readings.has_proposal:
            readings = _find_meaning(readings, _Dialogue(may_ask, yes, asked_before, reasons))
        if yes and _lack_readings_alone(readings):
            readings = readings.add_options({"allow_missing": True})
        if not may_ask:
            return readings
        new_options = ask_for_missing(_read_for_questions(readings), asked_before)
        if not new_options:
            return readings
        readings = readings.add_options(new_options)


def _lack_readings_alone(readings: _StatedReadings) -> bool:
    """Return whether nothing but missing readings keeps the import from reading the files."""
    faults = _read_for_questions(readings).faults
    return bool(faults) and all(fault.option == "allow_missing" for fault in faults)


@dataclass(frozen=True)
class _Dialogue:
    """Dialogue with a person: what may be asked, and what was asked and written before."""

    may_ask: bool
    yes: bool  # whether the option `--yes` accepts a proposal
    asked_before: set[str]  # names of options that are not asked again
    reasons: set[str]  # why there was no proposal


def _find_meaning(readings: _StatedReadings, dialogue: _Dialogue) -> _StatedReadings:
    """Return readings whose columns are understood: by names, by a template, or by the robot's proposal.

    Readings without an accepted proposal are returned with the answers of a person: then the usual questions
    follow.

    Raises:
        typer.Exit: the files do not have the meaning of the template, or `--yes` meets a doubt.
    """
    is_wanted = dialogue.may_ask or dialogue.yes or readings.meaning is not None or readings.robot is not None
    if not is_wanted:
        return readings
    from jointstiff.service.proposals.proposed_import import NoProposal  # imports numpy

    while True:
        proposed = _propose(readings, yes=dialogue.yes)
        if proposed is None:
            return readings
        if not isinstance(proposed, NoProposal):
            break
        answered = _answer_fault(proposed, readings, dialogue)
        if answered is None:
            _report_no_proposal(proposed, readings, dialogue)
            return readings
        readings = answered
    if readings.meaning is not None or _is_accepted(proposed, may_ask=dialogue.may_ask, yes=dialogue.yes):
        return readings.replace_by_proposal(proposed)
    return replace(readings, is_refused=True)


def _propose(readings: _StatedReadings, *, yes: bool) -> ProposedImport | NoProposal | None:
    """Return the robot's proposal for readings; None if names explain them, or if there is no reason for one.

    With `yes`, which accepts a proposal, the proposal leaves out lines that are missing.

    Raises:
        CampaignError: the files cannot be read; the texts name command-line options in place of fields.
    """
    from jointstiff.service.resources.documents import parse_document
    from jointstiff.service.resources.imports import import_files, lack_meaning

    options = _split_typed_header(readings.options, readings.sources)
    request = parse_document(options | {"show_faults": True, "accept_proposal": yes}, ImportRequest)
    robots = _list_robots(readings.robot)
    stated = None if readings.robot is None else robots[0].robot
    if readings.meaning is None:
        with _name_options_in_errors():
            answer = import_files(readings.sources, request, stated)
        if not answer.faults:
            return _propose_frame(readings, request, robots, answer)
        if not lack_meaning(readings.sources, request, stated):
            return None
    from jointstiff.service.proposals.search import propose_import  # imports numpy

    return propose_import(readings.sources, request, robots, readings.meaning)


def _propose_frame(
    readings: _StatedReadings, request: ImportRequest, robots: Sequence[KnownRobot], answer: ImportAnswer
) -> ProposedImport | None:
    """Return the proposal for files that names explain, if positions are in another frame; else None."""
    if readings.robot is None or not answer.findings:
        return None
    from jointstiff.service.proposals.frames import is_in_another_frame, propose_frame  # imports numpy

    if not is_in_another_frame(answer):
        return None
    return propose_frame(readings.sources, request, robots[0], answer)


def _answer_fault(
    lacking: NoProposal, readings: _StatedReadings, dialogue: _Dialogue
) -> _StatedReadings | None:
    """Ask a person for the option without which there is no proposal; None without such a question."""
    fault = lacking.fault
    if not dialogue.may_ask or fault is None or fault.option is None or readings.meaning is not None:
        return None
    answer = _read_for_questions(readings)
    message = ImportFault(
        **fault.place._asdict(),
        reason=fault.reason,
        remedy=fault.remedy,
        option=fault.option,
        words=list(fault.words),
    )
    about_fault = answer.model_copy(update={"faults": [message], "missing_fields": []})
    is_new = any(name not in dialogue.asked_before for name, _ in _find_questions(fault.option, about_fault))
    if not is_new:
        return None
    typer.echo(f"{_name_options(fault.reason)}.", err=True)
    return readings.add_options(ask_for_missing(about_fault, dialogue.asked_before))


def _report_no_proposal(lacking: NoProposal, readings: _StatedReadings, dialogue: _Dialogue) -> None:
    """Print why the robot's kinematics explains no columns, if a person has reason to expect a proposal.

    Raises:
        typer.Exit: the files do not have the meaning that a template states; or the robot explains some of
            the columns, and a person has to state the others.
    """
    if readings.meaning is not None:
        raise cli.print_failure(
            f"the files do not fit the template: {_name_options(lacking.reason)}",
            "import files of the same form, or leave out --template",
        )
    is_expected = dialogue.yes or readings.robot is not None
    if lacking.remedy and is_expected:
        raise cli.print_failure(_name_options(lacking.reason), _name_options(lacking.remedy))
    if is_expected and lacking.reason not in dialogue.reasons:
        dialogue.reasons.add(lacking.reason)
        typer.echo(f"no proposal: {_name_options(lacking.reason)}", err=True)


def _is_accepted(proposed: ProposedImport, *, may_ask: bool, yes: bool) -> bool:
    """Show a proposal; return whether a person, or the option `--yes`, accepts the proposal.

    Raises:
        typer.Exit: `yes` meets a question that the numbers cannot decide.
    """
    typer.echo(f"{_name_options(proposed.sentence)}.", err=True)
    doubt = proposed.proposal.doubt
    if doubt:
        typer.echo(f"The numbers cannot decide: {doubt}.", err=True)
    if may_ask and not yes:
        # Two meanings that fit alike have no default answer.
        return typer.confirm("Take it?", default=None if doubt else True, err=True)
    if yes and doubt:
        raise cli.print_failure(
            f"--yes does not accept a doubtful proposal: {doubt}",
            "check the axes and the signs of the joints, or state --robot",
        )
    if not yes:
        typer.echo("--yes accepts this proposal.", err=True)
    return yes


def _list_robots(robot: RobotDocument | None) -> Sequence[KnownRobot]:
    """Return the stated robot, or without one the arms of the catalogue."""
    from jointstiff.service.conversion.prepared import prepare_robot
    from jointstiff.service.problems import as_campaign_error
    from jointstiff.service.resources.known_robots import catalogue_robots
    from jointstiff.solver.mechanics.robot import KnownRobot

    if robot is None:
        return list(catalogue_robots())
    with _name_options_in_errors(), as_campaign_error("robot"):
        return [KnownRobot(robot.name, prepare_robot(robot).robot)]


def _read_arm(name: str) -> RobotDocument:
    """Return the document of an arm of the catalogue."""
    from jointstiff.service.conversion.catalogue import find_arm, nominal_robot

    return nominal_robot(find_arm(name, "--robot"))


def _read_files(readings: _StatedReadings) -> ImportAnswer:
    """Read the files; the texts of the result name command-line options in place of fields."""
    from jointstiff.service.resources.documents import parse_document

    with _name_options_in_errors():
        robot = None if readings.robot is None else _prepare_checked_robot(readings.robot)
        request = parse_document(_split_typed_header(readings.options, readings.sources), ImportRequest)
        answer = readings.import_by(request, robot)
    return _name_options_in_answer(answer)


def _prepare_checked_robot(robot: RobotDocument) -> Robot:
    """Return the robot against which readings are checked."""
    # Imported only here, as it imports numpy, which takes time.
    from jointstiff.service.conversion.prepared import prepare_robot

    return prepare_robot(robot).robot


def _read_for_questions(readings: _StatedReadings) -> ImportAnswer:
    """Read the files with the options that are stated so far; the answer has all faults."""
    from jointstiff.service.resources.documents import parse_document

    with _name_options_in_errors():
        robot = None if readings.robot is None else _prepare_checked_robot(readings.robot)
        fields = _split_typed_header(readings.options, readings.sources) | {"show_faults": True}
        request = parse_document(fields, ImportRequest)
        return readings.import_by(request, robot)


def _name_options_in_answer(answer: ImportAnswer) -> ImportAnswer:
    """Return the result of an import whose texts name command-line options in place of fields."""
    missing = [_name_options(text) for text in answer.missing]
    findings = answer.findings
    if findings is not None:
        findings = [each.model_copy(update={"remedy": _name_options(each.remedy)}) for each in findings]
    return answer.model_copy(update={"missing": missing, "findings": findings})


def _split_typed_header(options: Options, sources: Sequence[SourceFile]) -> Options:
    """Return options in which the header, typed as one text, is a list of cells.

    The header is split at the delimiter that the options state or that is detected in the files.
    """
    from jointstiff.service.importing.source_grids import detect_delimiter

    if not isinstance(header := options.get("header"), str):
        return options
    detected: Delimiter | None = next(filter(None, map(detect_delimiter, sources)), None)
    delimiter: Delimiter | None = options.get("delimiter") or detected
    return {**options, "header": _split_header(header, delimiter)}


@contextmanager
def _name_options_in_errors() -> Iterator[None]:
    """Change errors raised in the block: their texts name command-line options in place of fields."""
    from jointstiff.service.problems import CampaignError, describe_first_fault

    try:
        with naming_options(ImportRequest, _FORMS):
            yield
    except CampaignError as error:
        problem = error.problem
        where = problem.where or ""
        name, _, rest = where.partition(".")
        if name in ImportRequest.model_fields:
            place = f"{option_flag(ImportRequest, name, _FORMS)} {rest}".rstrip()
            changes = {"where": place}
            if problem.errors:
                faults = problem.errors
                changes["detail"] = describe_first_fault(len(faults), place, faults[0].reason)
            problem = problem.model_copy(update=changes)
        raise CampaignError(problem) from None


def _name_options(text: str) -> str:
    """Return a text that names command-line options in place of the fields of `ImportRequest`.

    A campaign that is not to be used is refused by this command, not by a later request.
    """
    text = _UNIT_IN_TEXT.sub(r'give `units`: {"\1": "\2"}', text)
    from jointstiff.solver.text import PAST_DO_NOT_USE

    text = text.replace(PAST_DO_NOT_USE, _PAST_ERRORS)
    return name_options_in_text(ImportRequest, text, _FORMS)


def _parse_pairs(
    texts: Sequence[str],
    message: type[Message],
    option: str,
    values: Mapping[str, Any] = MappingProxyType({}),
) -> dict[str, Any]:
    """Parse the values KEY=VALUE of an option; return the stated fields of a message.

    `values` has the texts of VALUE that are no texts in the message, and their values there.

    Raises:
        CampaignError: a key or a value is not valid.
    """
    from jointstiff.service.problems import CampaignError
    from jointstiff.service.resources.documents import parse_document

    fields = Options()
    for text in texts:
        key, _, value = text.partition("=")
        fields[key.strip()] = values.get(value.strip(), value.strip())
    try:
        parsed = parse_document(fields, message)
    except CampaignError as error:
        where = f"{option}.{error.problem.where}"
        raise CampaignError(error.problem.model_copy(update={"where": where})) from None
    return {name: getattr(parsed, name) for name in parsed.model_fields_set}


def _read_template(path: Path | None) -> tuple[Options, TableMeaning | None]:
    """Read the template of an earlier import; return its fields, and the meaning that a robot proposed."""
    from jointstiff.schemas.meaning import ImportTemplate
    from jointstiff.service.resources.documents import read_document

    if path is None:
        return {}, None
    template = read_document(path, ImportTemplate)
    fields: Options = template.model_dump(mode="json", exclude_defaults=True, exclude={"meaning"})
    # A template without `length_unit` states its lengths in the unit of the files.
    if "length_unit" not in fields and (fields.get("units") or {}).get("length") == "m":
        fields["length_unit"] = "m"
    return fields, template.meaning


def _build_template(template: ImportRequest, readings: _StatedReadings) -> ImportRequest:
    """Return the template of an import, with the meaning of columns that a robot proposed.

    The columns of the table that was written by the proposal are no columns of the files.
    """
    if readings.meaning is None:
        return template
    from jointstiff.schemas.meaning import ImportTemplate
    from jointstiff.service.proposals.options import OPTIONS_OF_COLUMNS  # imports the messages

    fields = template.model_dump(mode="json", exclude_defaults=True, exclude=set(OPTIONS_OF_COLUMNS))
    if template.units is not None:
        fields["units"] = template.units.model_dump(include={"force", "moment"})
    statements = _split_typed_header(readings.statements or {}, readings.sources)
    return ImportTemplate(**{**fields, **statements, "meaning": readings.meaning})


def _write_template(
    path: Path,
    answer: ImportAnswer,
    template: ImportRequest | None,
    refuse_existing: Callable[[Path], None],
) -> None:
    """Write the template of an import, which holds its options, to a JSON file.

    `refuse_existing` refuses a file that must not be replaced.

    Raises:
        typer.Exit: information is missing, or the file cannot be written.
    """
    if template is None:
        if not answer.missing:
            reason = (
                "no template was written: the files have too many columns or too long headers for a template"
            )
            raise cli.print_failure(reason, "import files with fewer columns and shorter headers")
        missing = "; ".join(answer.missing)
        raise cli.print_failure(
            f"no template was written, because information is missing: {missing}",
            "add the missing information",
        )
    refuse_existing(path)
    cli.write_json(path, template.model_dump(mode="json", exclude_defaults=True))


def _write_campaign(path: Path, imported: _Imported, refuse_existing: Callable[[Path], None]) -> None:
    """Write a campaign file; without a robot, write only the measurement set.

    If only unloaded positions or a weight step were read, write these, with the robot if it is known.
    `refuse_existing` refuses a file that must not be replaced.

    Raises:
        typer.Exit: information is missing, or the file cannot be written.
    """
    written = _choose_content(path, imported)
    if cli.has_content(path, written.document):
        typer.echo(f"{path} has this content already; now: {written.next_step}", err=True)
        return
    refuse_existing(path)
    cli.write_json(path, written.document)
    typer.echo(f"wrote {path}, {written.name}; now: {written.next_step}", err=True)


class _WrittenContent(NamedTuple):
    """Content of a file that the command writes, and what a person does with it."""

    document: Options  # JSON object of the file
    name: str  # such as "a campaign"
    next_step: str  # command, or what is missing


def _choose_content(path: Path, imported: _Imported) -> _WrittenContent:
    """Return what the file at a path gets: a campaign, or as much of one as was read.

    Raises:
        typer.Exit: information is missing.
    """
    from jointstiff.service.problems import http_problem

    answer, robot = imported.answer, imported.robot
    robot_part: Options = {}
    if robot is not None:
        robot_part = {"robot": robot.model_dump(mode="json", exclude_unset=True)}
    robot_option = "" if robot_part else " --robot ROBOT"
    if answer.measurement_set is not None:
        measurement_set = answer.measurement_set.model_dump(mode="json", exclude_none=True)
        if not robot_part:
            return _WrittenContent(measurement_set, "a measurement set", "add a robot with --robot")
        campaign = {**robot_part, "measurement_set": measurement_set, **_choose_run_part(answer)}
        return _WrittenContent(campaign, "a campaign", f"jointstiff identify {path}")
    if answer.geometry is not None:
        poses = answer.geometry.model_dump(mode="json", exclude_none=True, exclude_unset=True)
        next_step = f"jointstiff geometry {path}{robot_option}"
        return _WrittenContent(poses | robot_part, "unloaded poses", next_step)
    if answer.weight_step is not None:
        step = answer.weight_step.model_dump(mode="json", exclude_none=True)
        next_step = f"jointstiff gearbox {path}{robot_option} --load KG±KG,X,Y,Z"
        return _WrittenContent(step | robot_part, "a weight step", next_step)
    missing = "; ".join(answer.missing)
    reason = f"nothing was written, because information is missing: {missing}"
    raise print_problem(http_problem(422, reason, "add the missing information"))


def _choose_run_part(answer: ImportAnswer) -> Options:
    """Return the options of the run of a campaign, under `run`; nothing if the defaults suit the readings.

    Readings without a load only are for a run that identifies the robot by its own weight.
    """
    run: Options = {}
    if answer.leave_out:
        run["leave_out"] = answer.leave_out
    if answer.geometry is not None:
        run["weight"] = {}
    return {"run": run} if run else {}


def is_terminal_input() -> bool:
    """Return whether the standard input is a terminal, so that a person can answer questions."""
    return sys.stdin.isatty()


def ask_for_missing(answer: ImportAnswer, asked_before: set[str]) -> Options:
    """Ask a person for the options that an import still needs.

    Args:
        answer: result of an import, with faults and missing fields.
        asked_before: names of options that were asked before and are not asked again; this function adds new
            names.

    Returns:
        Fields of the request that the person stated; empty if no question is left.
    """
    new_options: Options = {}
    faults = [fault.option for fault in answer.faults if fault.option is not None]
    for option in dict.fromkeys([*faults, *answer.missing_fields]):
        for name, question in _find_questions(option, answer):
            if name in asked_before:
                continue
            if not asked_before:
                typer.echo(_HOW_TO_ANSWER, err=True)
            asked_before.add(name)
            _add_answer(new_options, name, question())
    return _split_force(new_options)


def _add_answer(options: Options, name: str, value: object) -> None:
    """Add a person's answer to options: to the field `name`, or to a key of a field, as `units.length`.

    The load point may be a target: its name is stated by another field than the coordinates.
    """
    if name == "load_point" and isinstance(value, str):
        name = "load_point_target"
    field, _, key = name.partition(".")
    if key:
        options.setdefault(field, {})[key] = value
    else:
        options[field] = value


def ask_for_robot() -> str | None:
    """Ask for the measured robot; return its file or the name of an arm; None if the answer is `none`."""
    text: str = typer.prompt(
        "Measured robot, for the integrity checks: file or arm", default="none", err=True
    )
    return None if text == "none" else text


_HOW_TO_ANSWER: Final = "Press Enter for the answer in brackets; a question without brackets needs an answer."


def _find_questions(option: str, answer: ImportAnswer) -> Iterator[tuple[str, Callable[[], object]]]:
    """Yield the questions about a missing option, as (name of a field, function that asks for its value)."""
    if option in _QUESTIONS:
        yield option, _QUESTIONS[option]
    elif option == "sheet":
        words = next((fault.words for fault in answer.faults if fault.option == option), ())
        text = "Sheet or group, or several separated by ;"
        yield option, partial(typer.prompt, text, default=";".join(words) or None, err=True)
    elif option in {"force", "load_point", "flange_targets"}:
        yield from _find_vector_questions(option, answer)
    elif option == "state_words":
        yield from _find_state_questions(
            next(fault.words for fault in answer.faults if fault.option == option)
        )
    elif option in {"allow_missing", "accept_unusual"}:
        yield option, _build_confirmation(option, answer)
    elif option == "columns":
        columns = (column for file in answer.files for column in file.columns)
        for header in dict.fromkeys(column.header for column in columns if column.meaning == "unknown"):
            text = f"Meaning of column {header!r}, such as J1 [deg]"
            yield f"columns.{header}", partial(typer.prompt, text, default="ignore", err=True)


def _build_confirmation(option: str, answer: ImportAnswer) -> Callable[[], object]:
    """Return the question whether readings are left out that are missing, or unusual values are correct."""
    if option == "allow_missing":
        text = _describe_missing([fault for fault in answer.faults if fault.option == option])
        return partial(typer.confirm, text, default=True, err=True)
    text = f"Is this value correct: {'; '.join(answer.unusual)}?"
    return partial(typer.confirm, text, default=False, err=True)


def _describe_missing(faults: Sequence[ImportFault]) -> str:
    """Return the question whether readings that are missing or incomplete are left out."""
    named = [f"{fault.reason} in line {fault.line}" if fault.line else fault.reason for fault in faults]
    others = f" and {len(named) - _MAX_LINES} more" if len(named) > _MAX_LINES else ""
    return f"Leave out incomplete readings ({'; '.join(named[:_MAX_LINES])}{others})?"


def _find_vector_questions(option: str, answer: ImportAnswer) -> Iterator[tuple[str, Callable[[], object]]]:
    """Yield questions about the force and places on the flange, as (field, function that asks for it)."""
    if option == "load_point":
        yield option, partial(_ask_load_point, answer.targets)
        return
    if option == "force":
        likely = [
            text.partition("; ")[2]
            for field, text in zip(answer.missing_fields, answer.missing, strict=True)
            if field == option
        ]
        yield option, partial(_ask_force, _name_options("".join(likely)))
        return
    for target in answer.targets:
        text = f"{target} in the flange frame, X,Y,Z in mm"
        yield f"flange_targets.{target}", partial(_ask_vector, text, None)


def _prompt_choice(text: str, choices: tuple[str, ...], default: str | None) -> str:
    """Ask until the answer is one of the choices; return the answer. Enter alone returns the default."""

    def require_choice(value: str) -> str:
        """Return an answer if it is one of the choices; Typer asks again after a BadParameter."""
        if value not in choices:
            raise typer.BadParameter(f"answer one of {', '.join(choices)}")
        return value

    answer: str = typer.prompt(
        f"{text} ({', '.join(choices)})", default=default, value_proc=require_choice, err=True
    )
    return answer


def _find_state_questions(words: Sequence[str]) -> Iterator[tuple[str, Callable[[], object]]]:
    """Yield a question about the words for states in a file, as (name of a field, function that asks).

    For two words the function asks which word means "without load"; for a single word, which state it means.
    """
    if len(words) > 1:

        def ask_unloaded_word() -> dict[str, str]:
            """Ask which word means "without load"; return word → state."""
            unloaded = _prompt_choice("Word for readings without load", tuple(words), words[0])
            return {word: "unloaded" if word == unloaded else "loaded" for word in words}

        yield "state_words", ask_unloaded_word
    if len(words) == 1:
        (word,) = words
        yield f"state_words.{word}", partial(_prompt_choice, f"State that {word!r} means", _STATES, None)


def _ask_vector(text: str, default: str | None) -> tuple[float, ...]:
    """Ask a person for three numbers `X,Y,Z`, and return them; Enter alone returns those of `default`."""
    answer: tuple[float, ...] = typer.prompt(text, default=default, value_proc=cli.parse_vector, err=True)
    return answer


def _ask_force(likely: str) -> _TypedForce:
    """Ask a person for the force, after a sentence on what the files say; the sentence may be empty."""
    if likely:
        typer.echo(f"{likely}.", err=True)
    text = "Force on the robot in R0, such as 0,0,-981 N, or a hung weight, such as 100 kg"
    answer: _TypedForce = typer.prompt(text, value_proc=_parse_force_with_unit, err=True)
    return answer


def _parse_force_with_unit(text: str) -> _TypedForce:
    """Parse a force with its unit, so that the unit needs no question of its own.

    Raises:
        typer.BadParameter: the text has no unit, or is no force.
    """
    force = _parse_force(text)
    if force.unit is None:
        raise typer.BadParameter("add the unit N, daN, kN, kgf or lbf, such as 0,0,-981 N")
    return force


def _ask_load_point(targets: Sequence[str]) -> tuple[float, ...] | str:
    """Ask a person for the load point [mm], or which of the targets shows it; return the answer."""

    def parse_answer(text: str) -> tuple[float, ...] | str:
        """Return the name of a target as it is, and any other text as three numbers."""
        return text if text in targets else cli.parse_vector(text)

    answer: tuple[float, ...] | str = typer.prompt(
        "Load point in the flange frame, X,Y,Z in mm (at the flange: 0,0,0), or the target at the hook",
        value_proc=parse_answer,
        err=True,
    )
    return answer


_QUESTIONS: Final[Mapping[str, Callable[[], object]]] = {
    # field of the request → function that asks for its value
    **{option: partial(_prompt_choice, *question) for option, question in _CHOICE_QUESTIONS.items()},
    "by_order": partial(typer.confirm, "Number the rows of files without names?", default=False, err=True),
    "mean_of_repeats": partial(typer.confirm, "Use the mean of repeated readings?", default=False, err=True),
    "joint_tolerance": partial(
        typer.prompt, "Greatest difference of a joint between files, deg or mm", type=float, err=True
    ),
    "point_name": partial(
        typer.prompt, "Template of point names, such as {label}_{target}_{state}", err=True
    ),
}


def _describe_actions(answer: ImportAnswer, output: Path) -> str:
    """Return the command that applies a joint map that a finding suggests; empty without such a finding."""
    actions = [finding.action.kind for finding in answer.findings or () if finding.action is not None]
    if "apply_joint_map" not in actions:
        return ""
    command = f"jointstiff identify {output} --apply apply_joint_map"
    return f" and then `{command}`, which uses the suggested joint map"


def has_blocking_findings(answer: ImportAnswer) -> bool:
    """Return whether the inspection found an error that forbids the use of the readings."""
    return any(finding.weight == "do_not_use" for finding in answer.findings or ())


def make_import_report(answer: ImportAnswer) -> list[Part]:
    """Return the preview of an import for people: files with their columns, totals, gaps and findings."""
    from jointstiff.service.tables.table import Line

    parts: list[Part] = []
    for file in answer.files:
        parts += [Line(f"{file.file}: {_describe_format(file)}", "title"), _make_columns_table(file)]
        parts += _make_first_lines(file.assumptions, "assumed: ")
    if answer.measurement_set is not None and _has_load(answer.measurement_set):
        parts.append(Line(f"  {_describe_load(answer.measurement_set)}"))
    parts.append(Line(f"  {_describe_totals(answer)}"))
    parts += _make_first_lines(answer.assumptions, "assumed: ")
    if answer.geometry is not None and answer.measurement_set is None:
        pose_count = len(answer.geometry.poses or ())
        parts.append(Line(f"  complete: {pose_count} unloaded poses for a geometry", "good"))
    if answer.bodies:
        total_mass = sum(body.mass for body in answer.bodies)
        parts.append(Line(f"  masses: {len(answer.bodies)} bodies, {total_mass:g} kg together"))
    parts += _make_completeness_lines(answer)
    return [*parts, *_make_finding_lines(answer)]


def _make_columns_table(file: FilePreview) -> Table:
    """Return a table of a file's columns: header, meaning (with "?" if it was guessed), unit, two values."""
    from jointstiff.service.tables.table import build_text_table

    rows = list[list[str]]()
    for column in file.columns:
        values = [row[column.column - 1] for row in file.first_rows[:2] if column.column <= len(row)]
        meaning = _shorten(column.meaning) + (" ?" if column.guessed else "")
        first_values = "; ".join(map(_shorten, values))
        rows.append([str(column.column), _shorten(column.header), meaning, column.unit or "", first_values])
    titles = ["", "header", "read as", "unit", "first values"]
    return build_text_table(titles, rows, left_aligned=[1, 2, 3, 4])


def _has_load(readings: MeasurementSetDocument) -> bool:
    """Return whether a force other than zero acts on the robot: not its own weight alone."""
    return any(any(each.force) for each in readings.observations)


def _describe_load(readings: MeasurementSetDocument) -> str:
    """Return in words how large the force on the robot is, and where it acts."""
    from jointstiff.service.reports.run import describe_load_point, describe_loads

    point = describe_load_point(readings)
    return f"force on the robot: {describe_loads(readings)}; load point in the flange frame: {point}"


def _describe_totals(answer: ImportAnswer) -> str:
    """Return in words what all files together have: observations, joints, readings, targets and states."""
    joints = "no joint angles" if answer.joint_count is None else f"{answer.joint_count} joints"
    targets = ", ".join(answer.targets) or "none"
    states = ", ".join(answer.states) or "none"
    ellipsis = ", …" if answer.observation_count > len(answer.first_labels) else ""
    labels = ", ".join(answer.first_labels) + ellipsis
    return (
        f"{answer.observation_count} observations ({labels}), {joints}, "
        f"{answer.reading_count} complete readings; targets: {targets}; states: {states}"
    )


def _make_completeness_lines(answer: ImportAnswer) -> Iterator[Line]:
    """Yield lines on what is missing or, if nothing is missing, on what the files are complete for."""
    from jointstiff.service.tables.table import Line

    if answer.missing:
        yield from _make_first_lines(answer.missing, "missing: ", "care")
    elif answer.weight_step is not None:
        yield Line("  complete: a weight step of two encoders", "good")
    elif not has_blocking_findings(answer):
        # The measurement set of a file with unloaded poses only serves to identify by the robot's own weight.
        purpose = "" if answer.geometry is None else " for the robot's own weight"
        yield Line(f"  complete: a measurement set{purpose}", "good")


def _make_finding_lines(answer: ImportAnswer) -> Iterator[Line]:
    """Yield a line for each finding of the integrity checks, the most severe first.

    No line is yielded if no robot was stated, as the readings were then not checked.
    """
    from jointstiff.service.tables.report import VERDICTS
    from jointstiff.service.tables.table import Line

    if answer.findings == []:
        yield Line("  integrity: nothing suspicious", "good")
    severities = ("do_not_use", "use_with_care", "use")
    for finding in sorted(answer.findings or (), key=lambda finding: severities.index(finding.weight)):
        place = f"{finding.observation}: " if finding.observation else ""
        remedy = f"; {finding.remedy}" if finding.remedy else ""
        if finding.action is not None and finding.action.kind == "choose_robot":
            remedy += f" with `--robot '{finding.action.robot}'`"
        style: Any = "bad" if finding.weight == "do_not_use" else "care"
        weight = "note" if finding.is_remark else VERDICTS[finding.weight]
        yield Line(f"  {weight}: {place}{finding.message}{remedy}", style)


_FORMATS: Final = MappingProxyType(
    {"xlsx": "Excel", "mat": "MATLAB", "npz": "NumPy", "hdf5": "HDF5", "parquet": "Parquet"}
)
_FORMATS_BY_SUFFIX: Final = MappingProxyType({"ods": "OpenDocument"})
"""Formats that are stored as another format, which is read alike."""
_MARKDOWN: Final = ("md", "markdown")


def _describe_format(file: FilePreview) -> str:
    """Describe encoding, delimiter, decimal mark and number of rows of a file, or the sheet of a workbook."""
    rows = f"{file.row_count} row{'s' if file.row_count != 1 else ''}"
    suffix = file.file.lower().rpartition(".")[2]
    if file.format != "text":
        kind = _FORMATS_BY_SUFFIX.get(suffix) or _FORMATS[file.format]
        place = f", {'sheet' if file.format == 'xlsx' else 'group'} {file.sheet!r}" if file.sheet else ""
        return f"{kind}{place}, {rows}"
    cells = f"{file.delimiter} between cells, " if file.delimiter else ""
    is_markdown = suffix in _MARKDOWN and file.delimiter == "tab"  # tabs are in place of its upright lines
    cells = "Markdown, " if is_markdown else cells
    encoding = f"{file.encoding}, " if file.encoding else ""
    mark = f"decimal {file.decimal_mark}, " if file.decimal_mark else ""
    return f"{encoding}{cells}{mark}{rows}"


def _make_first_lines(texts: list[str], lead: str, style: Any = "dim") -> Iterator[Line]:  # noqa: ANN401 - a style
    """Yield at most `_MAX_LINES` texts as lines that begin with `lead`, then a line on how many are left."""
    from jointstiff.service.tables.table import Line

    for text in texts[:_MAX_LINES]:
        yield Line(f"  {lead}{text}", style)
    if len(texts) > _MAX_LINES:
        yield Line(f"  {lead}{len(texts) - _MAX_LINES} more (--json shows all)", style)


def _shorten(text: str) -> str:
    """Return a text cut to `_MAX_CELL_LENGTH` characters; unprintable characters are replaced."""
    printable = "".join(character if character.isprintable() else "\ufffd" for character in text)
    return printable if len(printable) <= _MAX_CELL_LENGTH else printable[: _MAX_CELL_LENGTH - 1] + "…"
