"""A watched folder with real files, a clock of its own and a service in this process."""

from __future__ import annotations

import json
import os

import anyio
import httpx2
import pytest
from support.guide_files import EXAMPLES
from support.in_process import served
from typer.testing import CliRunner

from jointstiff.schemas.imports import ImportRequest
from jointstiff.schemas.problem import Problem
from jointstiff.service.app import create_app
from jointstiff.service.cli.app import app
from jointstiff.service.cli.watch import _look
from jointstiff.service.library.client import Client
from jointstiff.service.library.delivery import Delivery
from jointstiff.service.library.errors import RefusedError
from jointstiff.service.library.folder import WatchedFolder
from jointstiff.service.store.store import Store
from jointstiff.simulator import default_arm, simulate_campaign


class InProcess(httpx2.BaseTransport):
    """Carries requests to an application in this process; it can be away."""

    def __init__(self, store):
        self._app = create_app(store)
        self.is_away = False
        self.refuses_with = None

    def handle_request(self, request):
        if self.is_away:
            raise httpx2.ConnectError("connection refused")
        if self.refuses_with is not None:
            problem = Problem(type="urn:x", title="no", status=self.refuses_with, detail="not now")
            return httpx2.Response(self.refuses_with, content=problem.model_dump_json())

        async def send():
            body = request.read()
            again = httpx2.Request(request.method, request.url, headers=request.headers, content=body)
            answer = await httpx2.ASGITransport(self._app).handle_async_request(again)
            headers = {name: value for name, value in answer.headers.items() if name != "content-encoding"}
            return httpx2.Response(answer.status_code, headers=headers, content=await answer.aread())

        return anyio.run(send)


class Bench:
    """A folder, a service, and time that passes only when it is told to."""

    def __init__(self, folder, store):
        self.folder, self.now = folder, 0.0
        self.store = store
        self.transport = InProcess(store)
        self.client = Client("http://localhost:8000", transport=self.transport, patience=0.0)
        self.robot = self.client.robots.create(campaign(0)["robot"]).id

    def watcher(self, template=None, robot=None):
        delivery = Delivery(self.client, robot or self.robot, template)
        return WatchedFolder(self.folder, delivery, clock=lambda: self.now, settle=60.0)

    def looks(self, watcher, times=2, step=5.0):
        events = []
        for _ in range(times):
            self.now += step
            events += watcher.look()
        return [(event.kind, event.file) for event in events]

    def drop(self, name, content):
        path = self.folder / name
        path.write_bytes(content if isinstance(content, bytes) else json.dumps(content).encode())
        return path

    def stored(self):
        sets = list(self.client.measurement_sets.list(robot_id=self.robot))
        runs = list(self.client.runs.list(robot_id=self.robot))
        assert len(sets) == len(runs)
        return len(sets)

    def names(self, place=""):
        folder = self.folder / place
        return sorted(path.name for path in folder.iterdir() if path.is_file()) if folder.exists() else []


def campaign(seed, **changes):
    document = simulate_campaign(default_arm(), load="pull", configurations=7, seed=seed)
    return document | changes


@pytest.fixture
def bench(tmp_path):
    with Store.open("sqlite://") as store:
        yield Bench(tmp_path, store)


def test_a_finished_file_becomes_a_set_and_a_run(bench):
    watcher = bench.watcher()
    bench.drop("a.json", campaign(1))
    assert bench.looks(watcher, 1) == []
    assert bench.looks(watcher, 1) == [("taken", "a.json")]
    assert bench.stored() == 1
    assert bench.names("done") == ["a.json"]
    assert bench.names() == []
    assert watcher.is_idle


def test_a_half_written_file_is_waited_for(bench):
    watcher, whole = bench.watcher(), json.dumps(campaign(1)).encode()
    path = bench.drop("a.json", whole[:2000])
    assert bench.looks(watcher, 8) == []
    path.write_bytes(whole)
    assert bench.looks(watcher, 2) == [("taken", "a.json")]
    assert bench.stored() == 1


def test_a_file_that_grows_between_looks_is_not_touched(bench):
    watcher, whole = bench.watcher(), json.dumps(campaign(1)).encode()
    path = bench.drop("a.json", b"")
    for end in range(0, len(whole), len(whole) // 5):
        path.write_bytes(whole[:end])
        assert bench.looks(watcher, 1) == []
    path.write_bytes(whole)
    assert bench.looks(watcher, 2) == [("taken", "a.json")]


def test_what_stays_broken_is_rejected_with_the_problem_beside(bench):
    watcher = bench.watcher()
    bench.drop("a.json", b'{"robot": ')
    assert bench.looks(watcher, 15) == [("rejected", "a.json")]
    assert bench.names("rejected") == ["a.json", "a.json.problem.json"]
    problem = Problem.model_validate_json((bench.folder / "rejected" / "a.json.problem.json").read_bytes())
    assert problem.status == 422
    assert bench.stored() == 0


def test_the_service_refuses_a_set_at_once(bench):
    """It is whole and understood, so that nothing is waited for."""
    document = campaign(1)
    document["measurement_set"]["observations"][2]["joints"].pop()
    bench.drop("a.json", document)
    assert bench.looks(bench.watcher()) == [("rejected", "a.json")]
    problem = json.loads((bench.folder / "rejected" / "a.json.problem.json").read_bytes())
    assert "joint" in problem["where"]


def test_a_file_renamed_while_it_is_written_is_taken_once(bench):
    watcher = bench.watcher()
    path = bench.drop("a.json.part", campaign(1))
    assert bench.looks(watcher, 3) == [("left", "a.json.part")]
    path.rename(bench.folder / "b.json")
    assert bench.looks(watcher, 3) == [("taken", "b.json")]
    assert bench.stored() == 1


def test_the_same_content_dropped_twice_is_one_set(bench):
    watcher = bench.watcher()
    bench.drop("a.json", campaign(1))
    bench.drop("b.json", campaign(1))
    assert bench.looks(watcher) == [("taken", "a.json"), ("taken", "b.json")]
    bench.drop("a.json", campaign(1))
    assert bench.looks(watcher) == [("taken", "a.json")]
    assert bench.stored() == 1
    assert bench.names("done") == ["a.json", "b.json"]


def test_another_file_of_the_same_name_is_another_campaign(bench):
    watcher = bench.watcher()
    for seed in (1, 2):
        bench.drop("a.json", campaign(seed))
        assert bench.looks(watcher) == [("taken", "a.json")]
    assert bench.stored() == 2
    assert len(bench.names("done")) == 2


def test_a_stopped_service_is_waited_for(bench):
    watcher = bench.watcher()
    bench.transport.is_away = True
    bench.drop("a.json", campaign(1))
    assert bench.looks(watcher, 6) == [("waiting", "")]
    assert bench.names() == ["a.json"]
    bench.transport.is_away = False
    assert ("taken", "a.json") in bench.looks(watcher, 8, step=30.0)
    assert bench.stored() == 1


@pytest.mark.parametrize("status", [401, 403, 429, 500, 507])
def test_no_file_is_rejected_for_what_it_cannot_help(bench, status):
    watcher = bench.watcher()
    bench.drop("a.json", campaign(1))
    bench.transport.refuses_with = status
    assert bench.looks(watcher, 4) == [("waiting", "")]
    bench.transport.refuses_with = None
    assert bench.looks(watcher, 2, step=90.0) == [("taken", "a.json")]


def test_a_crash_after_the_post_leaves_nothing_twice(bench, monkeypatch):
    bench.drop("a.json", campaign(1))
    with monkeypatch.context() as patched:
        patched.setattr("pathlib.Path.replace", _broken)
        assert bench.looks(bench.watcher()) == [("waiting", "a.json")]
    assert bench.stored() == 1
    assert bench.looks(bench.watcher()) == [("taken", "a.json")]
    assert bench.stored() == 1


def _broken(_path, _target):
    raise OSError(5, "Input/output error")


def test_two_watchers_take_each_file_once(bench):
    first, second = bench.watcher(), bench.watcher()
    for seed in range(1, 5):
        bench.drop(f"{seed}.json", campaign(seed))
    events = []
    for _ in range(3):
        bench.now += 5.0
        events += [step for pair in _alternating(first.look(), second.look()) for step in pair]
    taken = [event.file for event in events if event.kind == "taken"]
    assert sorted(taken) == [f"{seed}.json" for seed in range(1, 5)]
    assert bench.stored() == 4
    assert len(bench.names("done")) == 4


def _alternating(first, second):
    """Take turns, event by event, until both have ended."""
    ended = object()
    while True:
        pair = [next(first, ended), next(second, ended)]
        if pair == [ended, ended]:
            return
        yield [event for event in pair if event is not ended]


def test_a_file_that_replaces_another_at_the_last_moment_is_not_lost(bench, monkeypatch):
    """It takes the name after the first was posted, before that is moved."""
    watcher = bench.watcher()
    path = bench.drop("a.json", campaign(1))
    posted = Delivery.post

    def slow(self, file):
        answer = posted(self, file)
        bench.drop("a.json", campaign(2))
        return answer

    with monkeypatch.context() as patched:
        patched.setattr(Delivery, "post", slow)
        bench.looks(watcher)
    assert path.exists()
    assert bench.looks(watcher, 3) == [("taken", "a.json")]
    assert bench.stored() == 2


def test_a_share_that_is_away_is_waited_for(bench, monkeypatch):
    watcher = bench.watcher()
    bench.drop("a.json", campaign(1))
    with monkeypatch.context() as patched:
        patched.setattr(os, "scandir", _away)
        assert bench.looks(watcher, 3) == [("waiting", "")]
    assert bench.looks(watcher) == [("taken", "a.json")]


def _away(_folder):
    raise OSError(112, "Host is down")


def test_a_campaign_of_another_robot_is_rejected(bench):
    document = campaign(1)
    joints = document["robot"]["model"]["urdf"]
    document["robot"]["model"]["urdf"] = joints.replace('upper="', 'upper="1', 1)
    bench.drop("a.json", document)
    assert bench.looks(bench.watcher(), 15) == [("rejected", "a.json")]


def test_a_bare_measurement_set_is_taken(bench):
    bench.drop("set.json", campaign(1)["measurement_set"])
    assert bench.looks(bench.watcher()) == [("taken", "set.json")]


def test_tables_are_read_by_a_template(bench):
    table = (EXAMPLES / "readings.csv").read_bytes()
    bench.drop("a.csv", table)
    assert bench.looks(bench.watcher(), 3) == [("left", "a.csv")]
    assert bench.names() == ["a.csv"]
    template = ImportRequest(encoders="motor", load_point=(0.0, 0.0, 200.0), noise={"sigma": 0.02})
    bench.drop("b.csv", table)
    assert bench.looks(bench.watcher(template)) == [("taken", "a.csv"), ("taken", "b.csv")]
    assert bench.stored() == 1


def test_an_unknown_robot_is_said_at_once(bench):
    with pytest.raises(RefusedError, match="no robot"):
        Delivery(bench.client, "nobody").check()


def test_the_command_takes_what_is_there(tmp_path):
    with Store.open("sqlite://") as store, served(store) as url, Client(url) as client:
        robot = client.robots.create(campaign(0)["robot"])
        for seed in (1, 2):
            (tmp_path / f"{seed}.json").write_text(json.dumps(campaign(seed)))
        command = [
            "watch",
            str(tmp_path),
            "--robot",
            robot.id,
            "--server",
            url,
            "--interval",
            "0.1",
            "--once",
        ]
        done = CliRunner().invoke(app, command)
        assert done.exit_code == 0, done.output
        assert done.output.count("/v1/runs/") == 2
        assert len(list(client.runs.list(robot_id=robot.id))) == 2
        wrong = CliRunner().invoke(app, [*command[:3], "nobody", *command[4:]])
        assert wrong.exit_code == 2
        assert "no robot" in wrong.output


def test_links_lead_nowhere(bench, tmp_path_factory):
    """Who may write into the folder neither reads nor writes what only the watcher may."""
    own = tmp_path_factory.mktemp("own")
    (own / "secret.json").write_text(json.dumps(campaign(1)))
    (own / "precious").write_text("precious")
    (bench.folder / "linked.json").symlink_to(own / "secret.json")
    (bench.folder / "rejected").mkdir()
    (bench.folder / "rejected" / "bad.json.problem.json").symlink_to(own / "precious")
    bench.drop("bad.json", b"{nonsense")
    assert bench.looks(bench.watcher(), 20) == [("rejected", "bad.json")]
    assert (own / "precious").read_text() == "precious"
    assert bench.stored() == 0
    assert "nonsense" not in (bench.folder / "rejected" / "bad.json.problem.json").read_text()
    assert (bench.folder / "linked.json").is_symlink()


def test_a_link_is_no_place_to_keep_files(bench, tmp_path_factory):
    elsewhere = tmp_path_factory.mktemp("elsewhere")
    (bench.folder / "done").symlink_to(elsewhere)
    bench.drop("a.json", campaign(1))
    assert bench.looks(bench.watcher(), 3) == [("waiting", "a.json")]
    assert list(elsewhere.iterdir()) == []


def test_a_name_too_long_for_its_problem_is_cut(bench):
    watcher = bench.watcher()
    for mark in "ab":
        bench.drop(f"{'é' * 124}{mark}.json", {"mark": mark})  # 254 bytes
    bench.looks(watcher, times=20)
    assert watcher.is_idle
    kept = sorted((bench.folder / "rejected").iterdir())
    assert len(kept) == 4
    assert all(len(os.fsencode(path.name)) <= 255 for path in kept)
    assert sum(path.name.endswith(".problem.json") for path in kept) == 2


def test_a_file_name_steers_no_terminal(tmp_path, capsys):
    (tmp_path / "a\x1b]0;owned\x07\nb.csv").write_text("x")
    watched = WatchedFolder(tmp_path, NoDelivery(), clock=lambda: 0.0, settle=0.0)
    for _ in range(2):
        _look(watched, tmp_path)
    shown = "".join(capsys.readouterr())
    assert "owned" in shown
    assert "\x1b]" not in shown
    assert "\x07" not in shown


class NoDelivery:
    """Takes nothing."""

    suffixes = frozenset({".json"})

    def post(self, file):
        raise AssertionError(file.name)
