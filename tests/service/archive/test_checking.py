"""What `database check` calls a fault is what `restore` refuses: one code judges both."""

import json
import random
import re
import sqlite3
from collections.abc import Callable
from contextlib import closing
from itertools import count
from pathlib import Path
from typing import Any

import pytest
import sqlalchemy as sa
from support import kept

from jointstiff.service.archive.checking import check_database
from jointstiff.service.archive.restoring import restore_archive
from jointstiff.service.archive.writing import write_archive
from jointstiff.service.store.compression import compress_text
from jointstiff.service.store.documents import read_text
from jointstiff.service.store.store import Store

ID = re.compile("[0-9a-f]{32}")
TABLES = [
    sa.table(name, sa.column("sequence"), sa.column("document"))
    for name in ("robots", "measurement_sets", "jobs")
]


def remove_a_field(document: dict[str, Any], draw: random.Random) -> None:
    del document[draw.choice(sorted(document))]


def change_a_value(document: dict[str, Any], draw: random.Random) -> None:
    document[draw.choice(sorted(document))] = draw.choice([None, -1, "x", [], {}])


def add_a_field(document: dict[str, Any], _: random.Random) -> None:
    document["weather"] = "fine"


def give_another_id(document: dict[str, Any], _: random.Random) -> None:
    document["id"] = "somebody else"


def change_within(document: dict[str, Any], draw: random.Random) -> None:
    inner = draw.choice([each for each in document.values() if isinstance(each, dict) and each])
    inner[draw.choice(sorted(inner))] = draw.choice([None, -1, "x", [], {"y": 1}])


FAULTS: list[Callable[[dict[str, Any], random.Random], None]] = [
    remove_a_field,
    change_a_value,
    add_a_field,
    give_another_id,
    change_within,
]


@pytest.fixture(params=["sqlite", "postgresql"])
def empty(request: pytest.FixtureRequest, tmp_path: Path) -> Callable[[], str]:
    """Call it for the URL of an empty database; all of one kind."""
    if request.param == "postgresql":
        return request.getfixturevalue("new_postgresql_database")
    numbers = count()
    return lambda: f"sqlite:///{tmp_path / f'{next(numbers)}.db'}"


def upgrade_kept(url: str) -> None:
    """Make a kept database, upgrade it, and rewrite its documents."""
    kept.restore(kept.kept_numbers()[-1], url)
    with Store.open(url, upgrade=lambda _: None) as store:
        store.old_documents.rewrite(600.0)


def plant(url: str, draw: random.Random, number: int) -> None:
    """Plant faults in distinct rows. A few contents are no documents any more."""
    engine = sa.create_engine(url.replace("postgresql://", "postgresql+psycopg://"))
    with engine.begin() as connection:
        rows = [
            (table, *row)
            for table in TABLES
            for row in connection.execute(sa.select(table.c.sequence, table.c.document).order_by("sequence"))
        ]
        for table, sequence, content in draw.sample(rows, number):
            document = json.loads(read_text(content))
            draw.choice(FAULTS)(document, draw)
            changed = compress_text(json.dumps(document))
            if draw.random() < 0.2:
                changed = changed[: draw.randrange(len(changed))]
            connection.execute(sa.update(table).where(table.c.sequence == sequence).values(document=changed))
    engine.dispose()


def test_check_and_restore_agree_on_100_planted_faults(empty: Callable[[], str], tmp_path: Path) -> None:
    draw, found = random.Random(113), 0  # noqa: S311 - of a test
    nowhere = empty()
    for number in range(10):
        url = empty()
        upgrade_kept(url)
        plant(url, draw, 10)
        faults = {ID.findall(sentence)[0] for sentence in check_database(url).faults}
        archive = tmp_path / f"{number}.zip"
        unread = {ID.findall(sentence)[0] for sentence in write_archive(url, archive).damaged}
        restored = restore_archive(archive, nowhere, dry_run=True)
        refused = {each.split(":")[0] for table in restored.tables.values() for each in table.reasons}
        assert faults == unread | refused
        found += len(faults)
    assert found > 60, "a document may stay valid, such as one whose optional field is removed"


@pytest.mark.parametrize("number", kept.kept_numbers())
def test_a_kept_database_has_no_fault_before_and_after_its_upgrade(number: str, tmp_path: Path) -> None:
    url = f"sqlite:///{tmp_path / 'kept.db'}"
    kept.restore(number, url)
    assert check_database(url).faults == []
    with Store.open(url, upgrade=lambda _: None):
        pass
    assert check_database(url).faults == []


@pytest.mark.parametrize("number", ["0019", "0021", "0022"])
def test_a_run_that_requests_the_former_loss_absolute_is_raised(number: str, tmp_path: Path) -> None:
    path = tmp_path / "kept.db"
    kept.restore(number, f"sqlite:///{path}")
    with closing(sqlite3.connect(path, isolation_level=None)) as connection:
        query = "SELECT sequence, document FROM jobs WHERE kind = 'run' AND schema = ? LIMIT 1"
        ((sequence, content),) = connection.execute(query, (int(number),))
        document = json.loads(read_text(content))
        document["request"]["loss"] = "absolute"
        change = "UPDATE jobs SET document = ? WHERE sequence = ?"
        connection.execute(change, (compress_text(json.dumps(document)), sequence))
    assert check_database(f"sqlite:///{path}").faults == []
