"""What other programs read from the database by SQL: the queries of docs/sql.md, run by foreign tools."""

import csv
import io
import json
import re
import shutil
import sqlite3
import subprocess
import zlib
from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest
from support import kept
from support.everything import Filling, campaign

from jointstiff.service.store.store import Store

GUIDE = (Path(__file__).parents[3] / "docs" / "sql.md").read_text(encoding="utf-8")
OF_A_ROBOT, CHANGED, POSTED = (
    dict(zip(("sqlite", "postgresql"), 2 * found if len(found) == 1 else found, strict=True))
    for found in (
        re.findall(r"```sql\n(.*?)```", section, re.DOTALL) for section in GUIDE.split("\n## ")[1:4]
    )
)
"""Kind of database → query."""
Query = Callable[[str], list[dict[str, Any]]]


@pytest.fixture(scope="module")
def stored(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, Any], str]:
    """An SQLite file with a robot that wears, its last run, and the name of the robot."""
    path = tmp_path_factory.mktemp("sql") / "jointstiff.db"
    documents = [campaign(f"worn_{number}") for number in (1, 7)]
    with Store.open(f"sqlite:///{path}") as store, kept.client_of(store) as client:
        filling = Filling(client)
        robot = filling.add("robots", documents[0]["robot"])
        runs = [filling.run(filling.measure(document, robot)) for document in documents]
        run = client.get(f"/v1/jobs/{runs[-1]}").json()
        name = client.get(f"/v1/robots/{robot}").json()["name"]
        client.get("/v1/robots")  # brings the last campaign up to date
        set_id = run["request"]["measurement_set_id"]
        kept.add_runs_of_a_key(store, set_id, set_id)
    return path, run, name


@pytest.fixture(params=["sqlite", "postgresql"])
def query(request: pytest.FixtureRequest, stored: tuple[Path, dict[str, Any], str]) -> Query:
    """Call it for the rows of a query: by Python's `sqlite3`, and by `psql`."""
    path, _, _ = stored
    if request.param == "sqlite":

        def by_sqlite(queries: dict[str, str]) -> list[dict[str, Any]]:
            with closing(sqlite3.connect(path)) as connection:
                connection.row_factory = sqlite3.Row
                return [dict(row) for row in connection.execute(queries["sqlite"])]

        return by_sqlite
    url = request.getfixturevalue("new_postgresql_database")()
    Store.open(url).close()
    kept.copy_rows(f"sqlite:///{path}", url)

    def by_psql(queries: dict[str, str]) -> list[dict[str, Any]]:
        command = ["psql", "--no-psqlrc", "--csv", "--command", queries["postgresql"], url]
        done = subprocess.run(command, check=True, capture_output=True, text=True)
        return list(csv.DictReader(io.StringIO(done.stdout)))

    return by_psql


def test_all_runs_of_a_robot_with_stiffness_and_interval(
    query: Query, stored: tuple[Path, dict[str, Any], str]
) -> None:
    _, run, name = stored
    rows = query({kind: text.replace("simulated 6R", name) for kind, text in OF_A_ROBOT.items()})
    joints = run["result"]["joints"]
    assert len(rows) == 3 * len(joints), "two campaigns, and one run that a key posted"
    assert {row["unit"] for row in rows} == {"N.m/rad"}
    for row, joint in zip(rows[len(joints) :], joints, strict=False):
        assert (row["joint"], row["verdict"]) == (joint["name"], joint["verdict"])
        assert float(row["stiffness"]) == joint["stiffness"]
        assert [float(row["lower"]), float(row["upper"])] == joint["stiffness_interval"]


def test_joints_that_changed(query: Query, stored: tuple[Path, dict[str, Any], str]) -> None:
    rows = query(CHANGED)
    assert {row["joint"] for row in rows} == {"joint_3"}
    assert [row for row in rows if not -0.5 < float(row["relative_change"]) < -0.1] == []


def test_who_posted_what(query: Query) -> None:
    posted = [(row["key_name"] or None, row["kind"]) for row in query(POSTED)]
    assert sorted(posted, key=str) == [("tablet hall 3", "run")] * 2 + [(None, "run")] * 2


def test_a_document_is_read_by_zlib_alone(stored: tuple[Path, dict[str, Any], str]) -> None:
    path, run, _ = stored
    with closing(sqlite3.connect(path)) as connection:
        ((document,),) = connection.execute("SELECT document FROM jobs WHERE id = ?", (run["id"],))
    assert json.loads(zlib.decompress(document))["result"] == run["result"]


@pytest.mark.process
@pytest.mark.skipif(shutil.which("sqlite3") is None, reason="no shell of SQLite here")
def test_a_document_is_read_by_the_shell_of_sqlite(stored: tuple[Path, dict[str, Any], str]) -> None:
    path, run, _ = stored
    read = "sqlar_uncompress(document, 100000000)"
    assert read in GUIDE
    select = f"SELECT {read} FROM jobs WHERE id = '{run['id']}'"  # noqa: S608 - an id of ours
    done = subprocess.run(["sqlite3", path, select], check=True, capture_output=True, text=True)
    assert json.loads(done.stdout)["result"] == run["result"]
