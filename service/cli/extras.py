"""Options of three commands beside those of the request: where files of the result go."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, Final

import typer

from jointstiff.service.cli.answers import write_bytes, write_text
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
    finish: Callable[[Any, _Values, Sequence[Any]], None] = (
        _nothing  # writes files of a job that has a result
    )
    written: Callable[[_Values, Sequence[Any]], list[Path | None]] = _no_paths  # that it will write


def _write_robot(job: Any, values: _Values, _sources: Sequence[Any]) -> None:  # noqa: ANN401 - a Geometry
    if values["output"] is not None:
        robot = job.result.robot.model_dump(mode="json", exclude_none=True)
        write_text(values["output"], json.dumps(robot, indent=1))


def _write_campaign(job: Any, values: _Values, sources: Sequence[Any]) -> None:  # noqa: ANN401 - a Plan
    from jointstiff.service.library.plans import campaign_to_fill_in, read_planned

    if values["campaign"] is not None:
        campaign = campaign_to_fill_in(read_planned(sources[0]), job)
        write_text(values["campaign"], json.dumps(campaign, indent=1))


def _outputs(values: _Values, sources: Sequence[Any]) -> dict[str, Path]:
    """Return where each file of a program goes: a .dat beside the .src."""
    output, several = values["output"], len(sources[1]) > 1
    return {each.name: output.with_suffix(each.suffix) if several else output for each in sources[1]}


def _write_program(job: Any, values: _Values, sources: Sequence[Any]) -> None:  # noqa: ANN401 - a Program
    from jointstiff.service.kinds.program.work import unpacked

    outputs = _outputs(values, sources)
    for each in job.result.files:
        write_bytes(outputs[each.name], unpacked(each))
    if values["report"] is not None:
        write_bytes(values["report"], job.table("csv"))


EXTRAS: Final[Mapping[str, Extra]] = {
    "geometry": Extra(
        options={
            "robot": (NamedRobot, None),
            "output": (Annotated[Path | None, output_option("Write the robot there.", "ROBOT.json")], None),
        },
        passed=("robot",),
        finish=_write_robot,
    ),
    "plan": Extra(
        options={
            "campaign": (
                Annotated[
                    Path | None,
                    typer.Option(dir_okay=False, metavar="FILE", help="Write a campaign to fill in there."),
                ],
                None,
            )
        },
        finish=_write_campaign,
        written=lambda values, _: [values["campaign"]],
    ),
    "program": Extra(
        options={
            "output": (Annotated[Path, output_option("Write it there; a .dat beside it.")], ...),
            "report": (
                Annotated[Path | None, typer.Option(metavar="FILE", help="Write all points there, as CSV.")],
                None,
            ),
        },
        finish=_write_program,
        written=lambda values, sources: [*_outputs(values, sources).values(), values["report"]],
    ),
}
