"""Thousands of robots, sets and runs: rows of the service's own, copied in its database under other names."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import islice
from typing import Final
from uuid import UUID

import sqlalchemy as sa

from jointstiff.service.store.listing import make_search_text
from jointstiff.service.store.tables import jobs, last_campaigns, measurement_sets, robots

_BATCH: Final = 5_000

Row = dict[str, object]


@dataclass(frozen=True)
class Template:
    """Ids of a robot, of its set and of a run of the set, which are copied."""

    robot: str
    set: str
    run: str


@dataclass(frozen=True)
class Names:
    """Names of copies, each with a place `{}` for its number."""

    robot: str = "KR 240 cell {}"
    set: str = "campaign {}"
    serial_number: str = "W-{}"
    first_serial_number: int = 700_000


@dataclass(frozen=True)
class Copies:
    """Numbers and names of the copies of some templates.

    Robots are numbered; set n is of robot n modulo their number, and run n of set n // `runs_of_set`.
    """

    templates: Sequence[Template]
    robots: int
    runs: int
    runs_of_set: int = 1
    names: Names = Names()

    def add_robots_and_sets(self, engine: sa.Engine) -> None:
        """Insert the robots and their sets, without runs."""
        insert_rows(engine, robots, map(self._robot, range(self.robots)))
        with engine.begin() as connection:
            numbers = [{"robot_id": self._robot_of(n)[0], "changes": 1} for n in range(self.robots)]
            connection.execute(sa.insert(last_campaigns), numbers)
        insert_rows(engine, measurement_sets, map(self._set, range(self.runs // self.runs_of_set)))

    def add_runs(self, engine: sa.Engine) -> None:
        """Insert the runs."""
        insert_rows(engine, jobs, map(self.run, range(self.runs)))

    def run(self, number: int) -> Row:
        """Return the stated columns of a run."""
        of = number // self.runs_of_set
        robot_id, robot, name, serial_number = self._of_set(of)
        return {
            "id": make_id(3, number),
            "robot_id": robot_id,
            "measurement_set_id": make_id(2, of),
            "verdict": "do_not_use" if number % 10_000 == 5 else "use" if number % 3 else "use_with_care",
            "robot_name": robot,
            "measurement_set_name": name,
            "serial_number": serial_number,
            "words": make_search_text(name, robot, name, serial_number),
            "of": self._template(of).run,
        }

    def _template(self, number: int) -> Template:
        return self.templates[number % len(self.templates)]

    def _robot_of(self, number: int) -> tuple[str, str]:
        return make_id(1, number), self.names.robot.format(number)

    def _of_set(self, number: int) -> tuple[str, str, str, str]:
        """Return id and name of the robot of a set, the set's name and the arm's serial number."""
        arm = number % self.robots
        serial_number = self.names.serial_number.format(self.names.first_serial_number + arm)
        return *self._robot_of(arm), self.names.set.format(number), serial_number

    def _robot(self, number: int) -> Row:
        identifier, name = self._robot_of(number)
        words = make_search_text(name)
        return {"id": identifier, "name": name, "words": words, "of": self._template(number).robot}

    def _set(self, number: int) -> Row:
        robot_id, robot, name, serial_number = self._of_set(number)
        return {
            "id": make_id(2, number),
            "robot_id": robot_id,
            "name": name,
            "serial_number": serial_number,
            "robot_name": robot,
            "words": make_search_text(name, robot, serial_number),
            "of": self._template(number).set,
        }


def make_engine(url: str) -> sa.Engine:
    """Return an engine for many rows at a time, for which that of the store does not wait."""
    return sa.create_engine(url.replace("postgresql:", "postgresql+psycopg:"))


def make_id(kind: int, number: int) -> str:
    """Return an id as the service makes them: digits at random."""
    return UUID(int=(kind << 100) + number * 0x9E3779B97F4A7C15F39CC0605CEDC835 & (1 << 128) - 1).hex


def insert_rows(engine: sa.Engine, table: sa.Table, rows: Iterable[Row]) -> None:
    """Insert copies of rows of a table in batches, each one transaction."""
    statement, left = sa.text(_copying(table)), iter(rows)
    while batch := list(islice(left, _BATCH)):
        with engine.begin() as connection:
            connection.execute(statement, batch)


def _copying(table: sa.Table) -> str:
    """Return the statement that copies a row of a table, all but what its parameters say."""
    stated = _STATED[table.name]
    copied = [column.name for column in table.c if column.name not in {*stated, "sequence"}]
    columns, values = ", ".join([*stated, *copied]), ", ".join([*(f":{name}" for name in stated), *copied])
    return f"INSERT INTO {table.name} ({columns}) SELECT {values} FROM {table.name} WHERE id = :of"  # noqa: S608 - names of ours


_STATED: Final[Mapping[str, tuple[str, ...]]] = {
    "robots": ("id", "name", "words"),
    "measurement_sets": ("id", "robot_id", "name", "serial_number", "robot_name", "words"),
    "jobs": (
        "id",
        "robot_id",
        "measurement_set_id",
        "verdict",
        "robot_name",
        "measurement_set_name",
        "serial_number",
        "words",
    ),
}
