"""Options of three commands beside those of the request: where files of the result go."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, Final

import typer

from jointstiff.service.cli.answers import warn, write_bytes, write_text
from jointstiff.service.cli.options import NamedRobot, output_option

_Values = Mapping[str, Any]


def _nothing(_job: Any, _values: _Values, _sources: Sequence[Any]) -> None:  # noqa: ANN401
    """Write nothing."""


def _no_paths(_values: _Values, _sources: Sequence[Any]) -> list[Path | None]:
    """Return no paths."""
    return []


@dataclass(frozen=True)
class Extra:
    """Further options of a command."""

    options: Mapping[str, tuple[Any, Any]] = field(default_factory=dict)  # annotation and default by name
    passed: tuple[str, ...] = ()  # names of those that the function of the work takes
    # writes files of a job that has a result; returns the job to show, if it is another
    finish: Callable[[Any, _Values, Sequence[Any]], Any] = _nothing
    written: Callable[[_Values, Sequence[Any]], list[Path | None]] = (
        _no_paths  # paths that the command will write
    )


def _mended_file(values: _Values, sources: Sequence[Any]) -> Path:
    """Return where the mended campaign goes: beside the old one, unless the command says."""
    name = values["apply"].replace("_", "-")
    file: Path = sources[0]
    return values["output"] or file.with_name(f"{file.stem}-{name}{file.suffix}")


def _apply(job: Any, values: _Values, sources: Sequence[Any]) -> Any:  # noqa: ANN401 - runs
    """Apply an action, write the mended campaign, print a table of both runs, and return the new one."""
    from jointstiff.service.kinds.run import before_and_after
    from jointstiff.service.tables.stiffness import UNITS
    from jointstiff.service.tables.terminal import console, printed

    if values["apply"] is None:
        return job
    after = job.apply(values["apply"])
    path = _mended_file(values, sources)
    document = after.campaign.model_dump(mode="json", exclude_none=True, exclude_defaults=True)
    write_text(path, json.dumps(document, indent=1, ensure_ascii=False))
    warn(f"wrote {path}")
    if after.result is not None and not values["as_json"]:
        console().print(printed([before_and_after(job.result, after.result, UNITS[values["unit"]])]))
    return after


def _write_robot(job: Any, values: _Values, _sources: Sequence[Any]) -> None:  # noqa: ANN401 - a Geometry
    if values["output"] is not None:
        robot = job.result.robot.model_dump(mode="json", exclude_none=True)
        write_text(values["output"], json.dumps(robot, indent=1))


def _write_campaign(job: Any, values: _Values, sources: Sequence[Any]) -> None:  # noqa: ANN401 - a Plan
    from jointstiff.service.library.files import campaign_to_fill_in, read_planned

    if values["campaign"] is not None:
        campaign = campaign_to_fill_in(read_planned(sources[0]), job)
        write_text(values["campaign"], json.dumps(campaign, indent=1))


def _outputs(values: _Values, sources: Sequence[Any]) -> dict[str, Path]:
    """Return where each file of a program goes: a .dat beside the .src."""
    output, several = values["output"], len(sources[1]) > 1
    return {each.name: output.with_suffix(each.suffix) if several else output for each in sources[1]}


def _write_program(job: Any, values: _Values, sources: Sequence[Any]) -> None:  # noqa: ANN401 - a Program
    from jointstiff.service.kinds.program_work import unpacked

    outputs = _outputs(values, sources)
    for each in job.result.files:
        write_bytes(outputs[each.name], unpacked(each))
    if values["report"] is not None:
        write_bytes(values["report"], job.table("csv"))


EXTRAS: Final[Mapping[str, Extra]] = {
    "run": Extra(
        options={
            "apply": (
                Annotated[
                    str | None,
                    typer.Option(
                        metavar="ACTION",
                        help="Apply an action that a reason advises, such as exchange_columns or "
                        "convert_units: write the corrected campaign to a new file, and identify it.",
                    ),
                ],
                None,
            ),
            "output": (
                Annotated[
                    Path | None,
                    output_option("File to write the corrected campaign to; default: next to the old one."),
                ],
                None,
            ),
        },
        finish=_apply,
        written=lambda values, sources: [_mended_file(values, sources)] if values["apply"] else [],
    ),
    "geometry": Extra(
        options={
            "robot": (NamedRobot, None),
            "output": (
                Annotated[Path | None, output_option("File to write the identified robot to.", "ROBOT.json")],
                None,
            ),
        },
        passed=("robot",),
        finish=_write_robot,
    ),
    "plan": Extra(
        options={
            "campaign": (
                Annotated[
                    Path | None,
                    typer.Option(
                        dir_okay=False, metavar="FILE", help="File to write the campaign to fill in to."
                    ),
                ],
                None,
            )
        },
        finish=_write_campaign,
        written=lambda values, _: [values["campaign"]],
    ),
    "program": Extra(
        options={
            "output": (
                Annotated[
                    Path,
                    output_option("File for the compensated program; a .dat is written to its folder."),
                ],
                ...,
            ),
            "report": (
                Annotated[Path | None, typer.Option(metavar="FILE", help="CSV file to write all points to.")],
                None,
            ),
        },
        finish=_write_program,
        written=lambda values, sources: [*_outputs(values, sources).values(), values["report"]],
    ),
}
