"""Documents of `jointstiff import`: robot and template in, campaign and template out."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from jointstiff.service.cli.answers import failed, refuse_existing, refused, write_text

if TYPE_CHECKING:
    from jointstiff.schemas.imports import ImportAnswer
    from jointstiff.schemas.measurement import SetMetadata
    from jointstiff.schemas.robot import RobotDocument


def joined(options: dict[str, Any], others: dict[str, Any]) -> dict[str, Any]:
    """Return options with others over them; of dictionaries, such as units, entry by entry."""
    merged = dict(options)
    for field, value in others.items():
        before = merged.get(field)
        merged[field] = before | value if isinstance(before, dict) and isinstance(value, dict) else value
    return merged


def read_template(path: Path) -> dict[str, Any]:
    """Return the options of a template.

    Raises:
        CampaignError: the file is none.
    """
    from jointstiff.schemas.imports import ImportTemplate
    from jointstiff.service.conversion.parsing import MAX_SET_BYTES, MalformedError, parse
    from jointstiff.service.library.errors import CampaignError
    from jointstiff.service.problems.table import invalid_request

    with path.open("rb") as file:
        content = file.read(MAX_SET_BYTES + 1)
    try:
        template = parse(ImportTemplate, content)
    except MalformedError as error:
        raise CampaignError(invalid_request(error.faults)) from None
    known: dict[str, Any] = template.model_dump(mode="json", exclude_defaults=True)
    if "length_unit" not in known and (known.get("units") or {}).get("length") == "m":
        known["length_unit"] = "m"  # lengths of a template without it are in the files' unit
    return known


def write_template(path: Path, answer: ImportAnswer, *, overwrite: bool) -> None:
    """Write the template of an import.

    Raises:
        typer.Exit: something is missing, or the file cannot be written.
    """
    if answer.template is None:
        if not answer.missing:
            reason = "no template was written: the files have too many columns, or too long headers"
            raise failed(reason, "ignore columns that are not needed, in smaller files")
        raise failed(f"no template was written: {'; '.join(answer.missing)} missing", "add it")
    refuse_existing(path, overwrite=overwrite)
    template = answer.template.model_dump(mode="json", exclude_defaults=True)
    write_text(path, json.dumps(template, indent=1, ensure_ascii=False))


def noted_in(texts: Sequence[str]) -> SetMetadata:
    """Return what `--about KEY=VALUE` says of a set.

    Raises:
        CampaignError: a key or a value is none.
    """
    from pydantic import ValidationError

    from jointstiff.schemas.measurement import SetMetadata
    from jointstiff.service.library.errors import CampaignError
    from jointstiff.service.problems.table import invalid_request

    pairs = (text.partition("=") for text in texts)
    try:
        return SetMetadata.model_validate({key.strip(): value.strip() for key, _, value in pairs})
    except ValidationError as error:
        faults = [{**fault, "loc": ("--about", *fault["loc"])} for fault in error.errors()]
        raise CampaignError(invalid_request(faults)) from None


def with_notes(answer: ImportAnswer, noted: SetMetadata) -> ImportAnswer:
    """Return an answer whose measurement set says what was noted of it."""
    if answer.measurement_set is None:
        return answer
    notes = {name: getattr(noted, name) for name in noted.model_fields_set}
    return answer.model_copy(update={"measurement_set": answer.measurement_set.model_copy(update=notes)})


def write_campaign(path: Path, answer: ImportAnswer, robot: RobotDocument | None, *, overwrite: bool) -> None:
    """Write a campaign, or without a robot the measurement set; unloaded poses if the files have no more.

    Raises:
        typer.Exit: something is missing, or the file cannot be written.
    """
    from jointstiff.service.problems.table import http_problem
    from jointstiff.service.tables.terminal import console

    readings = answer.measurement_set or answer.poses
    if readings is None:
        missing = "; ".join(answer.missing)
        raise refused(http_problem(422, f"nothing was written, because this is missing: {missing}", "add it"))
    refuse_existing(path, overwrite=overwrite)
    document = readings.model_dump(mode="json", exclude_none=True)
    robot_part = {} if robot is None else {"robot": robot.model_dump(mode="json", exclude_unset=True)}
    if answer.measurement_set is None:
        document |= robot_part
        robots = "" if robot_part else " --robot ROBOT"
        what, command = "unloaded poses", f"jointstiff geometry {path}{robots}"
    elif robot_part:
        document = {**robot_part, "measurement_set": document}
        if answer.leave_out:
            document["run"] = {"leave_out": answer.leave_out}
        what, command = "a campaign", f"jointstiff identify {path}"
    else:
        what, command = "a measurement set", "add a robot with --robot"
    write_text(path, json.dumps(document, indent=1, ensure_ascii=False))
    console(stderr=True).print(f"wrote {path}, {what}; now: {command}", markup=False, soft_wrap=True)
