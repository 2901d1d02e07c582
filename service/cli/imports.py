"""The command `jointstiff import`: show tables with a role above each column, ask one question, write."""

from __future__ import annotations

import re
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Annotated, Any, Final, Literal

import typer

from jointstiff.schemas.fields import Message
from jointstiff.schemas.imports import ImportAnswer
from jointstiff.schemas.imports import Mapping as ImportMapping
from jointstiff.schemas.measurement import Grounds, MeasurementSetDocument, Noise, SetMetadata
from jointstiff.service.cli import options as cli

_WEIGHT: Final = re.compile(r"(\d+(?:\.\d+)?)\s*kg")
_OPTION_OF: Final = {
    "encoders": "--encoders",
    "load_point": "--load-point",
    "force": "--force",
    "flange_targets": "--flange-target",
}
"""Field of a question → option that answers the question."""
_TRUTHS: Final = {"true": True, "false": False}


def import_command(
    files: Annotated[
        list[Path], cli.file_argument("FILES...", "Tables: csv, xlsx, ods, json, mat, npz, hdf5.")
    ],
    robot: cli.NamedRobot = None,
    mapping: Annotated[
        Path | None, cli.file_option("Mapping of an earlier import: the meaning of each column.")
    ] = None,
    encoders: Annotated[
        Literal["motor", "secondary"] | None,
        typer.Option(
            metavar="<motor|secondary>",
            help="Encoders that close the position loop: motor, or secondary behind the gearboxes.",
        ),
    ] = None,
    load_point: Annotated[
        str | None, typer.Option(metavar="X,Y,Z", help="Load point in the flange frame [mm].")
    ] = None,
    load_point_target: Annotated[
        str | None, typer.Option(metavar="TARGET", help="Target at the hook, which shows the load point.")
    ] = None,
    force: Annotated[
        str | None,
        typer.Option(
            metavar="X,Y,Z", help="Force on the robot in R0 [N], such as 0,0,-981, or a hung mass: 100kg."
        ),
    ] = None,
    flange_target: Annotated[
        list[str] | None,
        typer.Option(metavar="TARGET=X,Y,Z", help="Place of a target in the flange frame [mm]. Repeatable."),
    ] = None,
    sigma: Annotated[
        float | None, typer.Option(metavar="MM", help="Standard uncertainty of a coordinate [mm].")
    ] = None,
    encoding: Annotated[str | None, typer.Option(help="Encoding of texts that are not in UTF-8.")] = None,
    name: Annotated[str | None, typer.Option(help="Name of the measurement set.")] = None,
    payload: Annotated[
        float | None, typer.Option(metavar="KG", help="Largest payload of the robot by its maker [kg].")
    ] = None,
    about: Annotated[
        list[str] | None,
        typer.Option(
            metavar="KEY=VALUE",
            help="Note about the measurement: measured_at, serial_number, item_condition, operator, "
            "instrument, conditions or notes. Repeatable.",
        ),
    ] = None,
    ground: Annotated[
        list[str] | None,
        typer.Option(
            metavar="KEY=VALUE",
            help="Way in which data of the load were measured. load_point=tracker (1 mm at least), drawing "
            "(3 mm) or hand (10 mm). force=scales, cell, pulley (5 ± 3 % less) or catalogue (3 %). "
            "tared=true or false for a cell. between=still, payload_declared or gravity_compensated. "
            "Repeatable.",
        ),
    ] = None,
    output: Annotated[
        Path | None,
        cli.output_option("File for the campaign, or for a measurement set without --robot, or for poses."),
    ] = None,
    save_mapping: Annotated[Path | None, cli.path_option("Write the mapping, for further files.")] = None,
    overwrite: cli.Overwrite = False,
    yes: Annotated[
        bool, typer.Option("--yes", help="Take the proposal: the first answer to each question.")
    ] = False,
    despite_errors: Annotated[
        bool,
        typer.Option("--despite-errors", help="Write the readings even if the checks find errors."),
    ] = False,
    as_json: cli.AsJson = False,
) -> None:
    """Import tables of readings as a campaign.

    Documented headers are understood. For any other table, the robot proposes the meaning of its columns.
    What numbers cannot say is one question at a time.
    """
    if output is not None:
        cli.check_ending(output, [".json"])
    stated: dict[str, Any] = {
        "encoders": encoders,
        "load_point": load_point and _parse_option("--load-point", cli.parse_vector, load_point, "mm"),
        "load_point_target": load_point_target,
        "force": force and _parse_option("--force", _parse_force, force),
        "flange_targets": dict(map(_parse_place, flange_target or ())) or None,
        "noise": None if sigma is None else {"sigma": sigma},
        "encoding": encoding,
    }
    known = {key: value for key, value in stated.items() if value is not None}
    readings = _Readings(files, robot, payload, name)
    answer = _answer_questions(readings, readings.read(mapping, known), yes=yes, as_json=as_json)
    _print(answer, as_json=as_json)
    inputs: list[object] = [*files, mapping, robot]
    is_complete = any((answer.measurement_set, answer.geometry, answer.weight_step))
    if answer.questions or not is_complete:
        fields = [question.field for question in answer.questions[:1] if question.field in _OPTION_OF]
        option = f" by {_OPTION_OF[fields[0]]}" if fields else ""
        cli.warn(f"nothing was written: answer the question{option}, or correct the mapping")
        raise typer.Exit(2)
    if save_mapping is not None:
        cli.refuse_existing(save_mapping, overwrite=overwrite, inputs=inputs)
        cli.write_json(save_mapping, answer.mapping.model_dump(mode="json", exclude_defaults=True))
        typer.echo(f"wrote {save_mapping}", err=True)
    are_wrong = any(finding.weight == "do_not_use" for finding in answer.findings or ())
    if not despite_errors and (answer.faults or are_wrong):
        cli.warn("nothing was written: correct the errors, or state --despite-errors")
        raise typer.Exit(1)
    if output is not None:
        cli.refuse_existing(output, overwrite=overwrite, inputs=inputs)
        cli.write_json(output, _build_document(readings, answer, about or (), ground or ()))
        next_step = _name_next_step(answer, output, has_robot=robot is not None)
        typer.echo(f"wrote {output}, {next_step}", err=True)


def is_terminal_input() -> bool:
    """Return whether a person can answer at the terminal."""
    return sys.stdin.isatty()


def _name_next_step(answer: ImportAnswer, output: Path, *, has_robot: bool) -> str:
    """Return what a file has, and the command that uses the file."""
    if answer.geometry is not None:
        what, command = "unloaded poses", "geometry"
    elif answer.weight_step is not None:
        what, command = "a weight step", "gearbox"
    else:
        what, command = "a campaign" if has_robot else "a measurement set", "identify"
    return f"{what}; now: {f'jointstiff {command} {output}' if has_robot else 'add --robot'}"


def _answer_questions(readings: _Readings, answer: ImportAnswer, *, yes: bool, as_json: bool) -> ImportAnswer:
    """Return the answer after the replies of a person, or with `yes` after the first choices."""
    asks = is_terminal_input() and not (yes or as_json)
    while answer.questions and (asks or yes):
        reply = _reply(answer, asks=asks)
        if reply is None:
            break
        answer = readings.read(reply, {})
    return answer


class _Readings:
    """Files with their robot."""

    def __init__(
        self, files: Sequence[Path], robot: str | None, payload: float | None, name: str | None
    ) -> None:
        from jointstiff.schemas.robot import RobotDocument
        from jointstiff.service.resources.documents import parse_document, read_robot

        self._files, self._name = files, name
        self.robot = None if robot is None else read_robot(robot, "--robot")
        if payload is not None:
            if self.robot is None:
                raise typer.BadParameter("needs the robot: add --robot", param_hint="--payload")
            fields = self.robot.model_dump(mode="json", exclude_unset=True)
            self.robot = parse_document({**fields, "payload": payload}, RobotDocument)

    def read(self, mapping: Path | ImportMapping | None, stated: dict[str, Any]) -> ImportAnswer:
        """Return the answer of an import by a mapping and further statements."""
        from jointstiff.service.library.reading import read

        readings = read(*self._files, robot=self.robot, mapping=mapping, name=self._name, **stated)
        return readings.answer


def _parse_option(name: str, parse: Callable[..., tuple[float, ...]], *arguments: str) -> tuple[float, ...]:
    """Parse the text of an option.

    Raises:
        typer.BadParameter: names the option.
    """
    try:
        return parse(*arguments)
    except typer.BadParameter as error:
        raise typer.BadParameter(error.message, param_hint=f"'{name}'") from None


def _parse_force(text: str) -> tuple[float, ...]:
    """Parse a force in N, or the weight of a mass in kg, which pulls along −z of R0.

    Raises:
        typer.BadParameter: the text is neither.
    """
    from jointstiff.service.conversion.units import KGF

    hung = _WEIGHT.fullmatch(text.strip())
    return (0.0, 0.0, -KGF * float(hung[1])) if hung else cli.parse_vector(text, unit="N")


def _parse_place(text: str) -> tuple[str, tuple[float, ...]]:
    """Parse the place of a target.

    Raises:
        typer.BadParameter: the text is no place.
    """
    target, separator, place = text.rpartition("=")
    if not separator:
        raise typer.BadParameter(f"'{text}' must be TARGET=X,Y,Z", param_hint="--flange-target")
    return target, cli.parse_vector(place, unit="mm")


def _reply(answer: ImportAnswer, *, asks: bool) -> ImportMapping | None:
    """Return the mapping after the answer to the first question; None if nobody answers the question.

    Args:
        answer: tables, mapping and questions.
        asks: whether a person is asked; otherwise the first choice is taken.
    """
    question = answer.questions[0]
    if not asks:
        return question.choices[0].mapping if question.choices and question.field is None else None
    _print(answer, as_json=False)
    if question.choices:
        numbers = [str(number) for number in range(1, len(question.choices) + 1)]
        reply = typer.prompt(f"answer ({', '.join(numbers)})", default="1", err=True)
        return question.choices[numbers.index(reply)].mapping if reply in numbers else None
    if question.field in ("force", "load_point"):
        reply = typer.prompt("x,y,z", err=True)
        vector = _parse_force(reply) if question.field == "force" else cli.parse_vector(reply, unit="mm")
        return answer.mapping.model_copy(update={question.field: vector})
    return None


def _print(answer: ImportAnswer, *, as_json: bool) -> None:
    """Print an answer as JSON, or as tables with the roles of their columns."""
    from jointstiff.service.imports.show import show

    typer.echo(answer.model_dump_json(indent=2) if as_json else show(answer))


def _build_document(
    readings: _Readings, answer: ImportAnswer, about: Sequence[str], ground: Sequence[str]
) -> dict[str, Any]:
    """Return what was read as a campaign, a measurement set without a robot, poses, or a weight step."""
    robot = readings.robot
    robot_part = {} if robot is None else {"robot": robot.model_dump(mode="json", exclude_unset=True)}
    if answer.measurement_set is not None:
        document = _add_notes(answer.measurement_set, about, ground).model_dump(
            mode="json", exclude_none=True
        )
        return {**robot_part, "measurement_set": document} if robot_part else document
    other: Message | None = answer.geometry or answer.weight_step
    return {**robot_part, **({} if other is None else other.model_dump(mode="json", exclude_none=True))}


def _add_notes(
    document: MeasurementSetDocument, about: Sequence[str], ground: Sequence[str]
) -> MeasurementSetDocument:
    """Return a measurement set with notes about the measurement, and the grounds of its uncertainties.

    Raises:
        CampaignError: a note or a ground is not valid.
    """
    from jointstiff.service.resources.documents import parse_document

    notes = _parse_pairs(about, SetMetadata)
    grounds = _parse_pairs(ground, Grounds)
    if grounds:
        noise = document.noise.model_dump(mode="json", exclude_unset=True) if document.noise else {}
        notes["noise"] = parse_document({**noise, "grounds": grounds}, Noise)
    return document.model_copy(update=notes)


def _parse_pairs(texts: Sequence[str], message: type[Message]) -> dict[str, Any]:
    """Return the fields of a message that texts KEY=VALUE state.

    Raises:
        CampaignError: a key or a value is not valid.
    """
    from jointstiff.service.resources.documents import parse_document

    pairs = [text.partition("=") for text in texts]
    fields = {key.strip(): _TRUTHS.get(value.strip(), value.strip()) for key, _, value in pairs}
    parsed = parse_document(fields, message)
    return {field: getattr(parsed, field) for field in parsed.model_fields_set}
