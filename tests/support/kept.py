"""A small database with one of everything that the store keeps, dumps of it, and the answers about it.

A dump of each layout lies in `tests/service/store/kept/`, written by the program of that layout:

    PYTHONPATH=tests python -m support.kept FOLDER POSTGRESQL_URL

writes the dumps of both databases, and one file of answers. They have the same rows, so the same answers.
"""

from __future__ import annotations

import gzip
import json
import re
import sqlite3
import subprocess
import sys
import tempfile
from collections import Counter
from collections.abc import Iterable, Iterator
from contextlib import closing, contextmanager
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from typing import Any, Final

import httpx2
import psycopg
import sqlalchemy as sa
from support import live
from support.api import DELETE, job_at, made, post
from support.copied_rows import make_engine
from support.everything import EXAMPLES, LINKS, Filling, campaign
from support.in_process import served

from jointstiff.schemas.run import RunRequest
from jointstiff.service.history.steps import STEPS
from jointstiff.service.jobs import Parts
from jointstiff.service.security.keys import make_key
from jointstiff.service.store.store import Store
from jointstiff.service.store.tables import LAYOUT, AuditEntry, metadata
from jointstiff.service.workers.engine import Queue
from jointstiff.simulator import robot_document, simulate_campaign

FOLDER: Final = Path(__file__).parents[1] / "service" / "store" / "kept"
NUMBER: Final = LAYOUT[:4]
POSTED_AGAIN: Final[dict[str, Any]] = {"method": "partial_pose", "elasticity": "joints"}
"""Options of a run that a test posts again after each upgrade."""
LISTS: Final = (
    "robots",
    "robots?deleted=true",
    "measurement-sets",
    "measurement-sets?open=true",
    "jobs",
    "jobs?deleted=true",
)
"""Lists whose first page is an answer."""


def make_database(number: str, path: Path) -> str:
    """Make the SQLite file of a layout; return its URL."""
    url = f"sqlite:///{path}"
    restore(number, url)
    return url


def list_numbers(document: Any) -> Iterator[float]:
    """Yield all numbers of a document."""
    if isinstance(document, dict):
        document = list(document.values())
    if isinstance(document, list):
        for value in document:
            yield from list_numbers(value)
    elif isinstance(document, int | float) and not isinstance(document, bool):
        yield document


def count_numbers(document: Any) -> Counter[float]:
    """Return how often a document has each number."""
    return Counter(list_numbers(document))


@contextmanager
def client_of(store: Store) -> Iterator[httpx2.Client]:
    """Serve a store in this process; yield a client."""
    with served(store) as url, httpx2.Client(base_url=url, timeout=300.0) as client:
        yield client


def fill(store: Store) -> dict[str, str]:
    """Fill a store with one of everything; return names of a few of its records → ids."""
    with client_of(store) as client:
        filling = Filling(client)
        named = jobs_of_every_kind(filling) | live_campaigns(filling) | hidden(filling)
    add_runs_of_a_key(store, named["small_set"], named["set"])
    return named


def jobs_of_every_kind(filling: Filling) -> dict[str, str]:
    """Two campaigns of one robot, with a job of each kind; runs of links and of a robot's own weight."""
    document = simulate_campaign(live.ARM, load="pull", configurations=6, seed=3)
    later = simulate_campaign(live.ARM, load="pull", configurations=6, seed=4)
    robot = filling.add("robots", document["robot"])
    first = filling.measure(document, robot, serial_number="KR-1", operator="A. Weaver", name="before")
    second = filling.measure(later, robot, serial_number="KR-1", operator="Ö. Smith", name="after")
    key = {"Idempotency-Key": "kept"}
    body = {"measurement_set_id": first} | POSTED_AGAIN
    run = made(filling.client, partial(filling.client.post, "/v1/runs?wait=60", json=body, headers=key))
    other = filling.run(second, **POSTED_AGAIN)
    box = {"run_id": run, "place": [0.0, 0.0, 0.25], "turns": 2, "force": [0.0, 0.0, -900.0]}
    area = {"area": [[1.2, -0.3, 0.6], [1.6, 0.3, 0.9]], "grid": [2, 2, 1]}
    sweeps = json.loads((EXAMPLES / "sweeps.json").read_text(encoding="utf-8"))
    filling.add("comparisons", {"run_ids": [run, other], "ordered": True})
    filling.add("plans", {"measurement_set_id": first, "readings": 2})
    filling.add("maps", box | area)
    filling.program(run, 4)
    filling.add("geometries", sweeps | {"name": "sweeps"})
    filling.identify(shortened(campaign("weight_1"), 8))
    filling.identify(campaign("beam_small"), **LINKS)
    return {"robot": robot, "set": first, "run": run, "other": other}


def live_campaigns(filling: Filling) -> dict[str, str]:
    """A live campaign under way, and a closed one."""
    closed = filling.live("closed campaign", 6)
    post(filling.client, f"/v1/measurement-sets/{closed}/close", None, 200)
    return {"live": filling.live("campaign under way", 2), "closed": closed}


def hidden(filling: Filling) -> dict[str, str]:
    """A deleted robot, a run that failed, and a deleted one."""
    robot = filling.add("robots", robot_document(live.ARM) | {"name": "given away"})
    assert filling.client.patch(f"/v1/robots/{robot}", json=DELETE).status_code == 200
    body = {"measurement_set_id": filling.measure(campaign("one_reading"))}
    failed = [filling.client.post("/v1/runs?wait=60", json=body) for _ in range(2)]
    assert [answer.status_code for answer in failed] == [201, 201], failed[0].text
    run = failed[1].json()["id"]
    assert filling.client.patch(job_at(run), json=DELETE).status_code == 200
    return {"deleted_robot": robot, "deleted_run": run, "small_set": body["measurement_set_id"]}


def shortened(document: dict[str, Any], count: int) -> dict[str, Any]:
    """Return a campaign with its first observations only, so that the dumps are small."""
    measured = document["measurement_set"]
    return document | {"measurement_set": measured | {"observations": measured["observations"][:count]}}


def add_runs_of_a_key(store: Store, small_set_id: str, set_id: str) -> None:
    """Add two keys, one of them revoked, an entry of the audit, and two runs that a key posted.

    The second run waits for a worker, and has no part in the queue.
    """
    now = datetime(2026, 11, 27, 12, tzinfo=UTC)
    keys = [make_key(name, "operator", now, None)[1] for name in ("tablet hall 3", "lost phone")]
    for key in keys:
        store.keys.add(key)
    store.keys.revoke(keys[1].id, now)
    by = keys[0]
    store.audit.add(AuditEntry(now, by.id, by.name, "127.0.0.1", "POST", "createRun", "/v1/runs", 201))
    request = RunRequest.model_validate({"measurement_set_id": small_set_id, "elasticity": "joints"})
    resampling = {"size": 4, "repetitions": 300, "seed": 4}
    long = request.model_validate(
        request.model_dump() | {"measurement_set_id": set_id, "resampling": resampling}
    )
    Parts(store).jobs["run"].create(request, None, by)
    Parts(store, lambda *_: None).jobs["run"].create(long, None, by)


def addresses(client: httpx2.Client) -> list[str]:
    """Return the addresses of all that the service answers about a kept database."""
    found = [f"/v1/{name}" for name in LISTS]
    for listed in ("robots", "measurement-sets", "measurement-sets?open=true", "jobs"):
        collection, _, filters = listed.partition("?")
        items = client.get(f"/v1/{collection}?limit=100&{filters}").json()["items"]
        found += [f"/v1/{collection}/{item['id']}" for item in items]
        if collection == "robots":
            found += [f"/v1/robots/{item['id']}/trend" for item in items]
    return found


def answers(client: httpx2.Client) -> dict[str, Any]:
    """Return address → answer."""
    found = {address: client.get(address) for address in addresses(client)}
    assert {answer.status_code for answer in found.values()} == {200}
    return {address: answer.json() for address, answer in found.items()}


def ask_again(client: httpx2.Client, kept_addresses: Iterable[str], number: str) -> dict[str, Any]:
    """Return address → answer of today to the same question.

    A trend of layouts before 0021 took the force's scale for the same in all campaigns.
    """
    found = {}
    for address in kept_addresses:
        is_of_same_cell = address.endswith("/trend") and number < "0021"
        query = "?same_cell=true" if is_of_same_cell else ""
        found[address] = client.get(f"{address}{query}").json()
    return found


def kept_numbers() -> list[str]:
    """Return the numbers of the layouts of which a database is kept."""
    return sorted({path.name[:4] for path in FOLDER.iterdir()})


def read_kept(number: str, name: str) -> str:
    """Return a file of a kept database: `sqlite.sql`, `postgresql.sql` or `answers.json`."""
    return gzip.decompress((FOLDER / f"{number}.{name}.gz").read_bytes()).decode()


def restore(number: str, url: str) -> None:
    """Make the kept database of a layout in an empty one."""
    if url.startswith("sqlite:///"):
        with closing(sqlite3.connect(url.removeprefix("sqlite:///"))) as connection:
            connection.executescript(read_kept(number, "sqlite.sql"))
    else:
        with psycopg.connect(url, autocommit=True) as connection:
            connection.execute(read_kept(number, "postgresql.sql"))


COMPUTED: Final = "live"
"""Field of an open set that is not stored: each answer computes it by the methods of its program."""


RENAMED: Final = {"same_load_point": "same_load"}
"""Name of a field of earlier layouts → its name today."""
MISSING = "missing"
DROPPED = tuple(f".{path}" for step in STEPS for path in step.dropped if step.before >= 18)
"""Ends of the places that have no field since layout 0018."""


def list_changes(before: object, now: object, place: str = "") -> Iterator[str]:
    """Yield the places of an answer that are missing now, or have another value.

    New fields are allowed, and fields that a step of a document says it drops.
    """
    if now == MISSING and re.sub(r"\[\d+\]", "[]", place).endswith(DROPPED):
        return
    if isinstance(before, dict) and isinstance(now, dict):
        for name, value in before.items():
            if name == COMPUTED:
                continue
            value_now = now.get(name, now.get(RENAMED.get(name, name), MISSING))
            yield from list_changes(value, value_now, f"{place}.{name}")
    elif isinstance(before, list) and isinstance(now, list) and len(before) == len(now):
        for number, (each, other) in enumerate(zip(before, now, strict=True)):
            yield from list_changes(each, other, f"{place}[{number}]")
    elif before != now:
        yield f"{place}: {before!r} is now {now!r}"


def copy_rows(source: str, target: str) -> None:
    """Copy all rows of a database into the empty tables of another one."""
    engines = make_engine(source), make_engine(target)
    with engines[0].connect() as reader, engines[1].begin() as writer:
        for table in metadata.sorted_tables:
            if table.name == "alembic_version":
                continue
            query = sa.select(*(column for column in table.c if column.name != "sequence"))
            if "sequence" in table.c:
                query = query.order_by(table.c.sequence)
            if rows := [dict(row._mapping) for row in reader.execute(query)]:
                writer.execute(sa.insert(table), rows)
    for engine in engines:
        engine.dispose()


def dump_sqlite(path: Path) -> str:
    """Return the SQL that makes an SQLite file anew."""
    with closing(sqlite3.connect(path)) as connection:
        return "\n".join(connection.iterdump()) + "\n"


def dump_postgresql(url: str) -> str:
    """Return the SQL that makes a PostgreSQL database anew, as `pg_dump` writes it."""
    command = ["pg_dump", "--inserts", "--no-owner", "--no-privileges", url]
    lines = subprocess.run(command, check=True, capture_output=True, text=True).stdout.splitlines()
    return "\n".join(line for line in lines if line and not line.startswith(("--", "\\"))) + "\n"


def write(folder: Path, postgresql_url: str) -> None:
    """Fill a database, and write its dumps and its answers into a folder."""
    with tempfile.TemporaryDirectory() as temporary:
        path = Path(temporary) / "kept.db"
        url = f"sqlite:///{path}"
        with Store.open(url) as store, closing(Queue(store, url)):
            fill(store)
            with client_of(store) as client:
                answered = answers(client)
        with Store.open(postgresql_url) as store, closing(Queue(store, postgresql_url)):
            pass  # both kinds of database have the tables of the queue, too
        copy_rows(url, postgresql_url)
        texts = {
            "sqlite.sql": dump_sqlite(path),
            "postgresql.sql": dump_postgresql(postgresql_url),
            "answers.json": json.dumps(answered, ensure_ascii=False, separators=(",", ":")),
        }
    folder.mkdir(exist_ok=True)
    for name, text in texts.items():
        (folder / f"{NUMBER}.{name}.gz").write_bytes(gzip.compress(text.encode(), 9, mtime=0))


if __name__ == "__main__":
    write(Path(sys.argv[1]), sys.argv[2])
