"""The command `jointstiff measure`: one reading after the other until a goal is reached."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final

import typer

from jointstiff.schemas.live import LiveOptions
from jointstiff.service.cli import options as cli
from jointstiff.service.cli.fields import field_options, gather_stated_fields, naming_options

if TYPE_CHECKING:
    from jointstiff.schemas.fields import Message
    from jointstiff.schemas.live import LiveState
    from jointstiff.schemas.rehearsal import RehearsedJoint
    from jointstiff.service.cli.at_terminal import AtTerminal
    from jointstiff.service.library.measure import LiveMeasurement
    from jointstiff.service.live.sources import SourceError

_FIELDS_WITHOUT_OPTION: Final = {
    "elastic_links",
    "directions",
    "goal",
    "plan_id",
    "prior",
}
"""Fields of `LiveOptions` for which the command has no option of the same form."""
_HELP_TEXTS: Final = {
    "load": "Load to apply, such as dead_weight:1500, dead_weight:150kg or any_direction:1500. Default: "
    "the strongest force of the campaign, as a weight if all forces pull down.",
    "targets": "Target in the flange frame, in mm; default: the targets of the campaign. Repeatable.",
    "work_area": "Work area of a goal about deflections, as two corners of a box in R0, in mm. Default: "
    "the box around the campaign's load points.",
}


def _make_text_option(name: str, metavar: str, text: str) -> Any:  # noqa: ANN401 - an annotation
    """Return the annotation of an option `name` with a text as value, such as `--server ADDRESS`."""
    return Annotated[str | None, typer.Option(name, metavar=metavar, help=text)]


_OWN_PARAMETERS: Final[cli.Parameters] = {
    "goal": (
        Annotated[
            str | None,
            typer.Option(
                metavar="GOAL",
                help='Goal of the measurement. "15 %": uncertainty of every stiffness that the load tests. '
                '"6 um": uncertainty of the deflection in the work area. "below 0.5 mm": decide whether '
                "the deflection stays below 0.5 mm. Required without --bridge.",
            ),
        ],
        None,
    ),
    "source": (
        Annotated[
            str | None,
            typer.Option(
                metavar="SOURCE",
                help="Source of the readings: simulated:SEED, lines:/dev/ttyUSB0, lines:tcp://host:port, "
                "lines:udp://:port, or robodk. Required unless --bridge is given.",
            ),
        ],
        None,
    ),
    "bridge": (
        _make_text_option(
            "--bridge",
            "SOURCE",
            "Source of positions for a page of the service. Needs --server and --code; omit campaign, "
            "--goal and --source.",
        ),
        None,
    ),
    "code": (_make_text_option("--code", "CODE", "Code that the page shows under *Tracker*."), None),
    "force": (
        _make_text_option(
            "--force",
            "X,Y,Z[N]",
            "Force in the work area, axes of R0; one number is a weight. Default: the force of the load.",
        ),
        None,
    ),
    "options": (
        Annotated[Path | None, cli.file_option("JSON file with further options, named as in the API.")],
        None,
    ),
    "server": (
        _make_text_option(
            "--server",
            "ADDRESS",
            "Service that stores the readings and shows them on its web page; default: this process stores "
            "them.",
        ),
        None,
    ),
    "most": (
        Annotated[
            int,
            typer.Option(
                min=1, max=200, help="Greatest number of readings, after which the measurement ends."
            ),
        ],
        200,
    ),
    "save": (Annotated[Path | None, cli.path_option("File to write the closed campaign to.")], None),
    "overwrite": (cli.Overwrite, False),
    "yes": (
        Annotated[
            bool,
            typer.Option("--yes", help="Ask no questions: take all readings at once, one after the other."),
        ],
        False,
    ),
    "pattern": (
        _make_text_option(
            "--pattern",
            "REGEX",
            "Format of the lines of text: a regular expression with the groups x, y, z, and optionally "
            "target and sigma.",
        ),
        None,
    ),
    "columns": (
        _make_text_option(
            "--columns",
            "NAME,NAME,...",
            "Columns of the lines of text in their order, such as target,x,y,z or -,x,y,z,sigma.",
        ),
        None,
    ),
    "source_unit": (
        _make_text_option(
            "--source-unit", "UNIT", "Unit of lengths in the lines of text: mm, m, um or in; default: mm."
        ),
        None,
    ),
    "request": (
        _make_text_option(
            "--request",
            "TEXT",
            "Text sent to a source of lines before each reading; {target}, {state}, {label}, {joints} [rad] "
            "and {force} [N] are replaced.",
        ),
        None,
    ),
    "baud": (
        Annotated[int | None, typer.Option(help="Speed of a serial line in bits per second; default: 9600.")],
        None,
    ),
    "timeout": (
        Annotated[
            float,
            typer.Option(
                min=0.1, help="Time without data, in seconds, after which a source is considered stopped."
            ),
        ],
        30.0,
    ),
    "unit": (cli.Unit, "MNm/rad"),
    "details": (cli.Details, False),
    "as_json": (cli.AsJson, False),
}
_LINE_OPTIONS: Final = ("pattern", "columns", "source_unit", "request", "baud")
"""Options of sources of lines of text."""


def build_measure_command() -> Callable[..., None]:
    """Return the function of the command `measure`, with options for fields of `LiveOptions`."""
    annotations = {
        name: annotation
        for name, annotation in field_options(LiveOptions)
        if name not in _FIELDS_WITHOUT_OPTION
    }
    for name, text in _HELP_TEXTS.items():
        option = annotations[name].__metadata__[0]  # the `typer.Option` of the annotation
        option.help = text

    def command(source_file: str | None, **values: Any) -> None:  # noqa: ANN401 - the signature set below has the types
        """Measure live: what to read next, what the readings say so far, and when it is enough.

        docs/live.md explains goals and sources.
        """
        if values["bridge"] is not None:
            _run_bridge(source_file, values)
            return
        if source_file is None or values["goal"] is None or values["source"] is None:
            raise cli.print_failure(
                "a campaign or robot, --goal and --source are needed",
                'write the arguments, such as: jointstiff measure campaign.json --goal "15 %" --source '
                "simulated:1",
            )
        if values["save"] is not None:
            inputs = [source_file, *cli.list_inputs(values)]
            cli.refuse_existing(values["save"], overwrite=values["overwrite"], inputs=inputs)
        # `gather_stated_fields` needs a value for every field: None for fields without an option here.
        values_of_fields = {name: None for name, _ in field_options(LiveOptions)} | values
        with naming_options(LiveOptions):
            _run_measure(source_file, gather_stated_fields(LiveOptions, values_of_fields), values)

    argument = Annotated[
        str | None,
        typer.Argument(
            metavar="CAMPAIGN_OR_ROBOT",
            help="File of a campaign that gives robot, loads, targets and noise. The readings of the "
            "campaign are not used. Instead of a campaign, name a robot (file, or arm of the "
            "catalogue) with --load and --target.",
        ),
    ]
    fields = {name: (annotation, None) for name, annotation in annotations.items()}
    arguments: dict[str, tuple[Any, Any]] = {"source_file": (argument, None)}
    cli.set_signature(command, arguments | dict(_OWN_PARAMETERS) | fields)
    return command


def _run_measure(source: str, stated: dict[str, Any], values: dict[str, Any]) -> None:
    """Measure a robot live, in this process or, with --server, over a service.

    Args:
        source: file of a campaign or a robot, or the name of an arm of the catalogue.
        stated: fields of `LiveOptions` that options of the command state.
        values: values of all options of the command.
    """
    from jointstiff.service.library.measure import measure

    asks = not values["yes"] and not values["as_json"] and sys.stdin.isatty()
    arguments = _gather_arguments(stated, values)
    if values["server"] is None:
        with measure(source, **arguments) as campaign:
            _measure_and_print(campaign, values, asks=asks)
        return
    # Imported only here, as it needs an extra that a measurement in this process does not need.
    from jointstiff.service.library.client import Client

    with Client(values["server"].rstrip("/"), warn=cli.warn) as client:
        client.ping()
        with measure(source, client=client, **arguments) as campaign:
            _measure_and_print(campaign, values, asks=asks)


def _gather_arguments(stated: dict[str, Any], values: dict[str, Any]) -> dict[str, Any]:
    """Return the arguments of `jointstiff.measure` by name; arguments as of `_run_measure`.

    Options of the command take precedence over the file of --options.
    """
    from jointstiff.service.resources.documents import read_object

    if values["options"] is not None:
        stated = read_object(values["options"]) | stated
    return {
        "goal": values["goal"],
        "source": values["source"],
        "force": _parse_force(values["force"]),
        "timeout": values["timeout"],
        "source_options": _line_options(values["source"], values, sample=not values["yes"]),
        "units": "m, rad, N, N.m",
        **stated,
    }


def _line_options(source: str, values: dict[str, Any], *, sample: bool) -> dict[str, Any]:
    """Return the options of a source of lines, of those that are stated among the values of all options."""
    options = {name: values[name] for name in _LINE_OPTIONS if values[name] is not None}
    return options | ({"sample": sample, "warn": cli.warn} if source.startswith("lines:") else {})


def _run_bridge(source_file: str | None, values: dict[str, Any]) -> None:
    """Send the positions of a source to the page that shows a code, until the page ends the bridge.

    `values` are the values of all options.

    Raises:
        typer.Exit: an option is missing, or belongs to a measurement at the terminal.
    """
    from jointstiff.service.library.bridge import TrackerBridge
    from jointstiff.service.library.client import Client

    _refuse_unsuitable_options(source_file, values)
    with Client(values["server"].rstrip("/"), warn=cli.warn) as client:
        options = _line_options(values["bridge"], values, sample=False)
        bridge = TrackerBridge(
            client, values["code"], values["bridge"], source_options=options, warn=cli.warn
        )
        cli.warn(f"joined the page of '{bridge.name}'; Ctrl-C ends")
        bridge.run()
    cli.warn("the page has ended the bridge")


def _refuse_unsuitable_options(source_file: str | None, values: dict[str, Any]) -> None:
    """Refuse options of a bridge that are missing, or that the page has chosen already.

    Raises:
        typer.Exit: names the options.
    """
    if source_file is not None or values["goal"] is not None or values["source"] is not None:
        raise cli.print_failure(
            "--bridge cannot be combined with a campaign, --goal or --source, because the page has opened "
            "the campaign",
            "omit these arguments, or omit --bridge",
        )
    if values["server"] is None or values["code"] is None:
        raise cli.print_failure(
            "--bridge needs --server and --code",
            "copy the command from the page: open the campaign there, then *Tracker*",
        )


def _parse_force(text: str | None) -> tuple[float, ...] | None:
    """Parse `X,Y,Z`, or one number as a weight along -z, into a force in R0 [N]; return None for None."""
    if text is None:
        return None
    try:
        weight = float(text)
    except ValueError:
        return cli.parse_vector(text)
    return 0.0, 0.0, -abs(weight)


def _measure_and_print(campaign: LiveMeasurement, values: dict[str, Any], *, asks: bool) -> None:
    """Measure until the end, close the campaign, save it if requested, and print its run.

    `values` are the values of all options; with `asks` the person at the terminal is asked questions.

    Raises:
        typer.Exit: the source has stopped, nothing was read, or the run has failed.
    """
    from jointstiff.service.cli.at_terminal import AtTerminal

    person = AtTerminal(campaign, asks=asks, confirmed=values["yes"])
    cli.warn(f"goal: {campaign.state.goal}")
    source_error = _read_until_end(campaign, person, values["most"])
    _print_end_state(campaign.state)
    if not campaign.count:
        raise cli.print_failure("no reading was taken", "measure again")
    run = campaign.close()
    if values["save"] is not None:
        campaign.campaign.save(values["save"])
        cli.warn(f"wrote {values['save']}")
    if values["as_json"]:
        typer.echo(json.dumps(_make_json_document(campaign, source_error), indent=2, ensure_ascii=False))
    else:
        _print_run(campaign, details=values["details"], unit=values["unit"])
    if source_error is not None or run.state != "succeeded":
        raise typer.Exit(1)


def _read_until_end(campaign: LiveMeasurement, person: AtTerminal, most: int) -> SourceError | None:
    """Read until the campaign ends, or `most` times; return the error with which the source stopped, if any.

    After an error the readings so far are identified.

    Raises:
        SourceError: the source stopped before the first reading.
    """
    from jointstiff.service.live import sources

    try:
        campaign.run_source(person, most)
    except sources.SourceError as error:
        if not campaign.count:
            raise
        cli.warn(f"{error.reason}\n  remedy: {error.remedy}")
        return error
    return None


def _print_end_state(state: LiveState) -> None:
    """Print the last state of a live campaign with its message."""
    names_state = state.state in {"reached", "closed"}  # the message of these states begins with their name
    cli.warn(state.message if names_state else f"{state.state}: {state.message}")


def _print_run(campaign: LiveMeasurement, *, details: bool, unit: str) -> None:
    """Print the run of a closed campaign and, if its readings were simulated, the stiffnesses behind them."""
    from jointstiff.service.kinds.run.kind import RUN
    from jointstiff.service.live.rehearsal import make_planted_table
    from jointstiff.service.reports.job import lay_out_job
    from jointstiff.service.tables.stiffness import UNITS
    from jointstiff.service.tables.terminal import console, lay_out_parts

    run = campaign.close()
    console().print(lay_out_job(RUN, run, details=details, unit=unit))
    planted = _compare_with_planted(campaign)
    if planted:
        confidence = run.request.confidence
        table = make_planted_table(planted, confidence, "the simulated source", UNITS[unit])
        console().print(lay_out_parts([table]))


def _compare_with_planted(campaign: LiveMeasurement) -> list[RehearsedJoint]:
    """Return planted stiffness and result of each joint; an empty list if no simulated arm was identified."""
    from jointstiff.service.live.rehearsal import compare_with_planted

    planted, run = getattr(campaign.source, "stiffness", None), campaign.close()
    if planted is None or run.result is None:
        return []
    return [
        compare_with_planted(joint, float(stiffness))
        for joint, stiffness in zip(run.result.joints, planted, strict=True)
    ]


def _make_json_document(campaign: LiveMeasurement, source_error: Any) -> dict[str, Any]:  # noqa: ANN401 - an error or None
    """Return the JSON document that `--json` prints: outcome, record of the readings, and run.

    `source_error` is the error with which the source stopped, or None.
    """
    state, run = campaign.outcome, campaign.close()
    fields = state.model_dump(
        mode="json", exclude={"revision", "still_needed", "next", "following", "residuals", "warnings"}
    )
    readings = fields.pop("readings")
    # Only held-out readings have a ratio; that of the last one is stated.
    ratios = [each["ball_ratio"] for each in readings if each["ball_ratio"] is not None]
    return {
        "readings": campaign.count,
        **fields,
        "withdrawn": sum(each["state"] == "withdrawn" for each in readings),
        "ball_ratio": ratios[-1] if ratios else None,
        "record": readings,
        "planted": [joint.model_dump(mode="json") for joint in _compare_with_planted(campaign)],
        "stopped": None if source_error is None else source_error.reason,
        "run_id": run.id,
        "error": _dump_or_none(run.error),
        "result": _dump_or_none(run.result),
    }


def _dump_or_none(message: Message | None) -> dict[str, Any] | None:
    """Return a message as a JSON object; None for no message."""
    return None if message is None else message.model_dump(mode="json")
