"""The way over from a database of another version: what it holds as campaign files, which can be posted."""

from __future__ import annotations

import json
import re
import shutil
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, closing
from pathlib import Path
from typing import Any, Final

from pydantic import BaseModel
from sqlalchemy import Connection, inspect, text

from jointstiff.schemas.measurement.measurement_set import MeasurementSetDocument
from jointstiff.schemas.robot import RobotDocument
from jointstiff.schemas.run.run import CampaignRun
from jointstiff.service.conversion.readings import ReadingArrays
from jointstiff.service.conversion.units import LENGTH
from jointstiff.service.problems.errors import StoreError
from jointstiff.service.store.database import open_existing

_TABLES: Final = {"robots", "measurement_sets", "jobs"}
_LONGEST_NAME: Final = 60
_FOLDER_MODE: Final = 0o700  # readings


def export_database(url: str, folder: Path) -> int:
    """Write each run's request with its robot and readings as a campaign file; return the number of files.

    A set without runs makes a file, too, and so does a robot without sets, by itself. What was deleted, and
    fields that this version does not know, are left out. The database is only read.

    Raises:
        StoreError: the folder exists, the database cannot be read, or has no tables of ours.
    """
    if folder.exists():
        raise StoreError(f"{folder} exists", "give the name of a new folder")
    number = 0
    with ExitStack() as made, closing(open_existing(url)) as database, database.reading() as connection:
        if not set(inspect(connection).get_table_names()) >= _TABLES:
            raise StoreError("the database has no Jointstiff tables", "check the URL of the database")
        try:
            folder.mkdir(mode=_FOLDER_MODE, parents=True)
            made.callback(shutil.rmtree, folder, ignore_errors=True)
            for number, document in enumerate(_documents(connection), start=1):
                name = re.sub(r"[^A-Za-z0-9]+", "-", _name(document))[:_LONGEST_NAME].strip("-")
                content = json.dumps(document, indent=1, ensure_ascii=False)
                (folder / f"{number:05d}-{name}.json").write_text(content + "\n", encoding="utf-8")
        except OSError as error:
            raise StoreError(f"cannot write {folder}: {error.strerror}", "choose another folder") from error
        except (ValueError, KeyError) as error:
            reason = f"after {number} files a document of the database cannot be read ({error})"
            raise StoreError(reason, "check it with `jointstiff doctor`, or restore a backup") from error
        made.pop_all()
    return number


def _name(document: Mapping[str, Any]) -> str:
    return str(document.get("measurement_set", document["robot"])["name"])


def _documents(connection: Connection) -> Iterator[dict[str, Any]]:
    """Yield campaigns, and robots without sets, in the order in which they were stored."""
    requests: dict[str, list[dict[str, Any]]] = {}
    for row in _rows(connection, "jobs"):
        if row["kind"] == "run":
            request = json.loads(row["document"])["request"]
            requests.setdefault(request["measurement_set_id"], []).append(_known(CampaignRun, request))
    robots = {row["id"]: json.loads(row["document"]) | _named(row) for row in _rows(connection, "robots")}
    without_sets = dict(robots)
    for row in _rows(connection, "measurement_sets"):
        without_sets.pop(row["robot_id"], None)
        campaign = {"robot": _known(RobotDocument, robots[row["robot_id"]]), "measurement_set": _set_of(row)}
        for run in requests.get(row["id"], [{}]):
            yield campaign | {"run": run}
    for robot in without_sets.values():
        yield {"robot": _known(RobotDocument, robot)}


def _rows(connection: Connection, table: str) -> Iterator[dict[str, Any]]:
    """Yield the rows of a table that were not deleted, one in memory at a time."""
    places = connection.execute(text(f"SELECT sequence FROM {table} ORDER BY sequence")).scalars().all()  # noqa: S608
    for place in places:
        one = text(f"SELECT * FROM {table} WHERE sequence = :place")  # noqa: S608
        row = connection.execute(one, {"place": place}).mappings().one()
        if row.get("deleted_at") is None:
            yield dict(row)


def _named(row: Mapping[str, Any]) -> dict[str, Any]:
    return {name: row[name] for name in ("name", "archived") if name in row}


def _known(message: type[BaseModel], document: Mapping[str, Any]) -> dict[str, Any]:
    """Return the fields that a message has, and that say something."""
    return {name: document[name] for name in message.model_fields if document.get(name) is not None}


def _set_of(row: Mapping[str, Any]) -> dict[str, Any]:
    """Return a set as it is posted; a frame by a geometry is stated by its numbers."""
    stored = json.loads(row["document"])
    document = _known(MeasurementSetDocument, {**stored, **_plain(row)})
    resolved = stored.get("resolved_frame")
    if resolved is not None and document["frame"].get("geometry_id") is not None:
        unit = LENGTH[document["units"]["length"]]
        document["frame"] = {
            "rotation": resolved["rotation"],
            "translation": [each / unit for each in resolved["translation"]],
            "forces": document["frame"].get("forces", "base"),
        }
        places = {name: [each / unit for each in at] for name, at in resolved["flange_targets"].items()}
        document["flange_targets"] = places | document.get("flange_targets", {})
    observations = ReadingArrays.unpack(row["arrays"]).observations()
    read = [each.model_dump(mode="json", exclude_none=True) for each in observations]
    return document | {"observations": read}


def _plain(row: Mapping[str, Any]) -> dict[str, Any]:
    """Return the columns of a set that are fields of its message."""
    columns = {name: row[name] for name in MeasurementSetDocument.model_fields if name in row}
    at = columns.pop("measured_at", None)  # SQLite keeps UTC, and does not say so
    time = f"{at}+00:00" if isinstance(at, str) else at and at.isoformat()
    return columns | {"measured_at": time}
