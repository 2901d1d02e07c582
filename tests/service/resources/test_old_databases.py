"""The way over from a database of another version."""

from __future__ import annotations

import hashlib
import json
from contextlib import closing
from pathlib import Path

import pytest
from sqlalchemy import text
from support.in_process import served
from typer.testing import CliRunner

from jointstiff.service.cli.app import app
from jointstiff.service.library.client import Client
from jointstiff.service.problems.errors import StoreError
from jointstiff.service.resources.old_databases import export_database
from jointstiff.service.store.database import Database
from jointstiff.service.store.store import Store
from jointstiff.simulator import default_arm, simulate_campaign

ROOT = Path(__file__).parents[3]


@pytest.fixture
def old(database_url, tmp_path):
    """A database of another layout: a robot, two sets of it, three runs of the first, a spare robot."""
    campaign = simulate_campaign(default_arm(), load="pull", configurations=12, seed=1)
    campaign["measurement_set"] |= {"operator": "Ada", "measured_at": "2026-11-20T10:00:00+01:00"}
    other = simulate_campaign(default_arm(), load="pull", configurations=9, seed=2)
    framed = {"rotation": [[0, -1, 0], [1, 0, 0], [0, 0, 1]], "translation": [0.1, 0.2, 0.3]}
    with Store.open(database_url) as store, served(store) as url, Client(url) as client:
        robot, stored = client.post_campaign(campaign)
        client.measurement_sets.create(other["measurement_set"] | {"robot_id": robot.id, "frame": framed})
        for options in ({}, {"method": "complete_pose"}, {"leave_out": ["c03"]}):
            client.runs.create(options | {"measurement_set_id": stored.id})
        client.robots.create(campaign["robot"] | {"name": "spare"})
        gone = client.robots.create(campaign["robot"] | {"name": "gone"})
        client.robots.delete(gone.id)
        before = _content(client)
    with closing(Database.open(database_url)) as database, database.writing() as connection:
        connection.execute(text("UPDATE alembic_version SET version_num = '0000'"))
    return database_url, tmp_path, before


def _content(client):
    """What a service holds, without what another one names anew."""
    new = {"id", "robot_id", "created_at", "measurement_set_id", "content_hash"}
    whole = [client.robots.get(each.id) for each in client.robots.list()]
    whole += [client.measurement_sets.get(each.id) for each in client.measurement_sets.list()]
    documents = [each.model_dump(mode="json", exclude=new) for each in whole]
    documents += [
        client.runs.get(each.id).request.model_dump(mode="json", exclude=new) for each in client.runs.list()
    ]
    return sorted(json.dumps(document, sort_keys=True) for document in documents)


def test_robots_sets_and_requests_arrive_once(old):
    url, folder, before = old
    file = folder / "jointstiff.db"
    content = hashlib.sha256(file.read_bytes()).hexdigest() if file.exists() else None
    shown = CliRunner().invoke(app, ["export-database", url, "-o", str(folder / "out")])
    assert shown.exit_code == 0, shown.output
    assert "5 files" in shown.output
    assert content is None or content == hashlib.sha256(file.read_bytes()).hexdigest()
    with Store.open("sqlite://") as store, served(store) as address, Client(address) as client:
        for _ in range(2):
            posted = CliRunner().invoke(app, ["post", str(folder / "out"), "--server", address])
            assert posted.exit_code == 0, posted.output
        after = _content(client)
    # The set without a run is posted as a campaign is: with one.
    assert len(after) == len(before) + 1
    assert set(before) <= set(after)


def test_targets_that_a_geometry_places_arrive(tmp_path):
    """In the set's units; a place that the set states itself wins."""
    units = {"length": "mm", "angle": "rad", "force": "N"}
    campaign = simulate_campaign(
        default_arm(), load="pull", configurations=4, units=units, readings="deflections"
    )
    sweeps = json.loads((ROOT / "examples" / "sweeps.json").read_text(encoding="utf-8"))
    del sweeps["robot"]
    readings = campaign["measurement_set"]
    for observation in readings["observations"]:
        for name, reading in zip(("P10", "P11", "P12"), observation["readings"], strict=True):
            reading["target"] = name
    readings["flange_targets"] = {"P11": [1.0, 2.0, 3.0]}
    url = f"sqlite:///{tmp_path / 'old.db'}"
    with Store.open(url) as store, served(store) as address, Client(address) as client:
        robot = client.robots.create(campaign["robot"])
        geometry = client.geometries.done(sweeps | {"robot_id": robot.id})
        frame = {"geometry_id": geometry.id}
        for places in (readings["flange_targets"], {}):
            framed = {"robot_id": robot.id, "frame": frame, "flange_targets": places}
            client.measurement_sets.create(readings | framed)
    assert export_database(url, tmp_path / "out") == 2
    first, second = sorted((tmp_path / "out").iterdir())
    exported = [json.loads(file.read_text())["measurement_set"]["flange_targets"] for file in (first, second)]
    in_mm = {
        target.name: pytest.approx([1e3 * x for x in target.position]) for target in geometry.result.targets
    }
    assert exported == [in_mm | readings["flange_targets"], in_mm]
    with Store.open("sqlite://") as store, served(store) as address, Client(address) as client:
        client.post_file(second)


def test_files_that_are_refused_keep_none_of_the_others_back(old):
    url, folder, _ = old
    assert export_database(url, folder / "out") == 5
    (folder / "out" / "00000-odd.json").write_text('{"robot": {"name": "odd"}}')
    with Store.open("sqlite://") as store, served(store) as address:
        posted = CliRunner().invoke(app, ["post", str(folder / "out"), "--server", address])
        assert posted.exit_code == 1
        assert "00000-odd.json: " in posted.stderr
        assert store.robots.page(limit=10).records[0].name == "spare"


def test_half_an_export_leaves_no_folder(old):
    url, folder, _ = old
    with closing(Database.open(url)) as database, database.writing() as connection:
        connection.execute(text("UPDATE measurement_sets SET document = '{' WHERE sequence = 2"))
    with pytest.raises(StoreError, match=r"after \d files a document"):
        export_database(url, folder / "out")
    assert not (folder / "out").exists()


def test_nothing_is_written_over_and_another_database_is_refused(old, tmp_path):
    url, folder, _ = old
    with pytest.raises(StoreError, match="exists"):
        export_database(url, folder)
    other = tmp_path / "other.db"
    other.write_bytes(b"")
    with pytest.raises(StoreError, match="no Jointstiff tables"):
        export_database(f"sqlite:///{other}", folder / "out")
    other.write_bytes(b"no database at all" * 100)
    with pytest.raises(StoreError, match="not a database"):
        export_database(f"sqlite:///{other}", folder / "out")
