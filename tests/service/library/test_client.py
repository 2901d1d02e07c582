"""The client while the service is away: requests are repeated, and nothing is stored twice."""

import json
import subprocess
import sys
import threading
import time
import uuid
from types import SimpleNamespace

import httpx2
import pytest

import jointstiff
from jointstiff.schemas.finding import Problem
from jointstiff.schemas.measurement import SetChange
from jointstiff.schemas.run import Campaign
from jointstiff.service.kinds.rooms import kind_of
from jointstiff.service.library import client as module
from jointstiff.service.library.client import Client
from jointstiff.service.problems import RefusedError
from jointstiff.simulator import default_arm, simulate_campaign


@pytest.fixture
def campaign():
    document = simulate_campaign(default_arm(), load="pull", configurations=8, seed=1)
    document["robot"]["name"] = document["measurement_set"]["name"] = uuid.uuid4().hex
    return document


class LossyTransport(httpx2.HTTPTransport):
    """Carries every request to the service, and loses the first answer to each."""

    def __init__(self):
        super().__init__()
        self.seen = set()

    def handle_request(self, request):
        answer = super().handle_request(request)
        mark = (request.method, request.url.path, request.headers.get("Idempotency-Key"))
        if mark not in self.seen and request.url.path != "/health":
            self.seen.add(mark)
            answer.read()
            answer.close()
            raise httpx2.ReadError("the connection was lost")
        return answer


def test_lost_answers_are_asked_for_again_and_nothing_is_stored_twice(service, campaign):
    warnings = []
    with Client(service.url, warn=warnings.append, transport=LossyTransport()) as client:
        client.ping()
        run = client.runs.wait(client.post(campaign))
        set_id = run.request.measurement_set_id
        comparison = client.compare(run, constraints=["positive"])
        robot_id = client.measurement_sets.get(set_id).robot_id
    assert run.state == comparison.state == "succeeded"
    assert len(warnings) == 7  # four runs of a comparison are posted, too
    assert all("the connection was lost; trying again" in warning for warning in warnings)
    with httpx2.Client(base_url=service.url) as plain:
        for collection, query, identifier in [
            ("robots", {"name": campaign["robot"]["name"]}, robot_id),
            ("measurement-sets", {"robot_id": robot_id}, set_id),
            ("comparisons", {"robot_id": robot_id}, comparison.id),
        ]:
            items = plain.get(f"/v1/{collection}", params=query).json()["items"]
            assert [item["id"] for item in items] == [identifier]


class AwayTransport(httpx2.BaseTransport):
    """A service that answered once and whose database is away since."""

    def __init__(self):
        self.requests = 0

    def handle_request(self, _request):
        self.requests += 1
        if self.requests == 1:
            return httpx2.Response(200, json={})
        problem = Problem(type="urn:x", title="away", status=503, detail="the database does not answer")
        return httpx2.Response(503, content=problem.model_dump_json())


def test_patience_ends(monkeypatch):
    """With what the service said last; a clock of our own goes as fast as the client sleeps."""
    now = [0.0]
    # In this module alone: the event loop of a service in another thread would sleep for hours.
    clock = SimpleNamespace(
        monotonic=lambda: now[0], sleep=lambda seconds: now.__setitem__(0, now[0] + seconds)
    )
    monkeypatch.setattr(module, "time", clock)
    warnings, transport = [], AwayTransport()
    with Client("http://nowhere", warn=warnings.append, transport=transport) as client:
        client.ping()
        with pytest.raises(RefusedError, match="the database does not answer"):
            client.runs.create({})
    assert module.PATIENCE_SECONDS - 5 < now[0] <= module.PATIENCE_SECONDS
    assert warnings == ["the database does not answer; trying again for 60 s"]
    assert transport.requests > 20


ESCAPE = "\x1b]0;owned\x07"
ALIEN = {
    "a page": httpx2.Response(200, html="<html>"),
    "a list": httpx2.Response(200, json=[1]),
    "no id": httpx2.Response(201, json={}),
    "an id that would steer a terminal": httpx2.Response(201, json={"id": "\x1b[2J"}),
    "not a text": httpx2.Response(200, content=b"\xff\xfe\x00"),
    "nested": httpx2.Response(200, content=b"[" * 100_000),
    "nothing": httpx2.Response(204),
    "a redirect": httpx2.Response(301, headers={"location": "http://elsewhere"}),
    "a status of its own": httpx2.Response(599),
    "no run": httpx2.Response(201, json={"id": "r1"}),
}


@pytest.mark.parametrize("answer", ALIEN.values(), ids=ALIEN.keys())
def test_an_answer_that_is_not_the_services_is_refused(answer):
    transport = httpx2.MockTransport(lambda _: answer)
    with Client("http://nowhere", transport=transport) as client:
        with pytest.raises(RefusedError, match="the answer is not from Jointstiff") as refused:
            client.runs.create({})
        assert refused.value.problem.remedy


def test_an_answer_that_cannot_be_decoded_is_refused():
    def garbled(_request):
        stream = httpx2.ByteStream(b"not compressed")
        return httpx2.Response(200, headers={"content-encoding": "gzip"}, stream=stream)

    with (
        Client("http://nowhere", transport=httpx2.MockTransport(garbled)) as client,
        pytest.raises(RefusedError, match="cannot be decoded"),
    ):
        client.ping()


def test_what_a_service_says_does_not_steer_the_terminal():
    problem = Problem(type="urn:x", title=ESCAPE, status=422, detail=ESCAPE, remedy=ESCAPE)
    transport = httpx2.MockTransport(lambda _: httpx2.Response(422, content=problem.model_dump_json()))
    with (
        Client("http://nowhere", transport=transport) as client,
        pytest.raises(RefusedError, match="owned") as refused,
    ):
        client.runs.create({})
    said = refused.value.problem
    assert all(text.isprintable() for text in (said.title, said.detail, said.remedy))


def test_what_is_no_address_is_refused():
    with pytest.raises(RefusedError, match="no answer from"):
        Client("http://[::1")


def test_nobody_at_the_address_is_told_at_once():
    began = time.monotonic()
    with Client("http://127.0.0.1:9") as client, pytest.raises(RefusedError, match="no answer"):
        client.runs.create({})
    assert time.monotonic() - began < module.PATIENCE_SECONDS / 2


@pytest.mark.process
def test_a_service_that_is_killed_and_started_again_is_waited_for(tmp_path, campaign):
    database, port = f"sqlite:///{tmp_path / 'x.db'}", 0
    process = serve(database, port)
    warnings, started = [], []
    try:
        address = process.stdout.readline().split()[3].rstrip(",")
        port = int(address.rpartition(":")[2])
        with Client(address, warn=warnings.append) as client:
            client.ping()
            robot = client.robots.create(campaign["robot"])
            stored = client.measurement_sets.create(campaign["measurement_set"] | {"robot_id": robot.id})
            process.kill()
            process.wait()
            starting = threading.Timer(0.3, lambda: started.append(serve(database, port)))
            starting.start()
            run = client.runs.wait(client.runs.create({"measurement_set_id": stored.id}))
            starting.join()
            listed = httpx2.get(f"{address}/v1/runs").json()["items"]
        assert run.state == "succeeded"
        assert len(warnings) == 1
        assert [item["id"] for item in listed] == [run.id]
    finally:
        for each in (process, *started):
            each.kill()
            each.wait()
            each.stdout.close()


def serve(database, port):
    command = [sys.executable, "-u", "-m", "jointstiff", "serve", "--workers", "0"]
    return subprocess.Popen(
        [*command, "--port", str(port), "--database", database], stdout=subprocess.PIPE, text=True
    )


def test_collections_are_read_page_by_page_and_deleted(service, campaign):
    with Client(service.url) as client:
        run = client.identify(campaign)
        assert run.state == "succeeded"
        stored = client.measurement_sets.get(run.request.measurement_set_id)
        robot = client.robots.get(stored.robot_id)
        assert robot.name == campaign["robot"]["name"]
        assert [each.id for each in client.robots.list(name=robot.name)] == [robot.id]
        client.robots.change(robot.id, {"name": "cell 3, renamed"})
        client.measurement_sets.change(stored.id, SetChange(operator="M. Keller"))
        assert client.robots.get(robot.id).name == "cell 3, renamed"
        assert client.measurement_sets.get(stored.id).operator == "M. Keller"
        other = client.runs.create({"measurement_set_id": stored.id, "method": "partial_pose"})
        listed = client.runs.list(robot_id=robot.id, limit="1")
        assert [each.id for each in listed] == [other.id, run.id]
        client.runs.delete(other.id)
        assert [each.id for each in client.runs.list(robot_id=robot.id)] == [run.id]
        with pytest.raises(RefusedError) as refused:
            client.robots.get("../runs")
        assert refused.value.problem.status == 404


def test_the_same_campaign_is_stored_once_and_again_where_it_was_deleted(service, campaign):
    with Client(service.url) as client:
        first = client.post(campaign, once=True)
        assert client.post(json.loads(json.dumps(campaign, sort_keys=True)), once=True).id == first.id
        other = client.post(Campaign.model_validate(campaign))
        assert other.id != first.id
        assert other.request.measurement_set_id == first.request.measurement_set_id
        stored = client.measurement_sets.get(first.request.measurement_set_id)
        assert client.described(campaign["robot"]) == stored.robot_id
        for run in (first, other):
            client.runs.delete(run.id)
        client.measurement_sets.delete(stored.id)
        anew = client.measurement_sets.get(client.post(campaign).request.measurement_set_id)
        assert anew.robot_id == stored.robot_id
        assert anew.id != stored.id
        assert [each.id for each in client.measurement_sets.list(robot_id=stored.robot_id)] == [anew.id]


@pytest.mark.parametrize(
    ("key", "environment", "sent"),
    [
        ("jst_given\n", None, "Bearer jst_given"),
        ("jst_given", "jst_environment", "Bearer jst_given"),
        (None, "jst_environment", "Bearer jst_environment"),
        (None, None, None),
    ],
)
def test_a_key_that_is_given_or_that_of_the_environment_is_sent(key, environment, sent, monkeypatch):
    if environment:
        monkeypatch.setenv("JOINTSTIFF_KEY", environment)
    seen = []

    def answer(request):
        seen.append(request.headers.get("authorization"))
        return httpx2.Response(200, json={})

    with Client("http://nowhere", key, transport=httpx2.MockTransport(answer)) as client:
        client.ping()
    assert seen == [sent]


@pytest.mark.parametrize("key", ["jst_two\nlines", "jst_☃"])
def test_a_key_that_cannot_be_sent_is_refused_without_being_shown(key):
    with pytest.raises(RefusedError) as caught:
        Client("http://nowhere", key)
    assert "jst_" not in str(caught.value)


@pytest.mark.parametrize("address", ["127.0.0.1:9199", "localhost", "ftp://localhost", ""])
def test_an_address_needs_its_scheme(address):
    with pytest.raises(RefusedError, match=r"not the address of a service; remedy: .*http://"):
        Client(address)


def test_a_run_of_a_service_applies_and_exports_as_one_in_process(service, campaign, tmp_path):
    """The same names over both doors give the same numbers and the same file."""
    for observation in campaign["measurement_set"]["observations"]:
        joints = observation["joints"]
        joints[1], joints[2] = joints[2], joints[1]
    with Client(service.url) as client:
        runs = [client.identify(campaign), jointstiff.identify(campaign)]
        mended = [run.apply("exchange_columns") for run in runs]
        contents = []
        for run in mended:
            run.export(tmp_path / "model.csv")
            contents.append((tmp_path / "model.csv").read_text().replace(run.id, "run"))
        with pytest.raises(RefusedError, match="do not use"):
            runs[0].export(tmp_path / "model.urdf")
        runs[0].export(tmp_path / "model.urdf", accept_verdict="do_not_use")
        mended[0].report(tmp_path / "report.html")
        with pytest.raises(jointstiff.CampaignError, match="does not advise"):
            mended[0].apply("exchange_columns")
    assert contents[0] == contents[1]
    assert "<robot" in (tmp_path / "model.urdf").read_text()
    assert "Report on joint stiffness" in (tmp_path / "report.html").read_text()
    assert mended[0].request.variant_of == runs[0].id
    for one, other in zip(mended[0].joints.values(), mended[1].joints.values(), strict=True):
        assert one == other


def test_the_trend_of_a_robot(service):
    with jointstiff.Client(service.url) as client:
        run = client.identify(simulate_campaign(default_arm(), configurations=6, seed=11))
        stored = client.measurement_sets.get(run.request.measurement_set_id)
        robot = client.robots.get(stored.robot_id)
        trends = [client.trend(each, encoders="motor") for each in (robot, robot.id)]
        assert trends[0] == trends[1]
        assert trends[0].robot_id == robot.id
        assert len(trends[0].joints) == 6
        with pytest.raises(jointstiff.RefusedError):
            client.trend("nobody")


def test_a_downloaded_column_is_text_where_any_of_its_cells_is(monkeypatch):
    """A map's places that are out of reach have words, and no numbers, in some cells."""
    columns = [
        {"name": "x", "unit": "m", "values": [1.0, 2.0]},
        {"name": "state", "unit": "", "values": ["reached", "out of reach"]},
        {"name": "remark", "unit": "", "values": [None, "at a limit"]},
    ]
    monkeypatch.setattr(Client, "file", lambda *_: json.dumps({"columns": columns}).encode())
    kind = kind_of("map")
    file = next(each for each in kind.files if each.suffix == "csv")
    sheet = object.__new__(Client).sheet(SimpleNamespace(kind="map", id="m"), file)
    assert sheet.columns == {
        "x [m]": [1.0, 2.0],
        "state": columns[1]["values"],
        "remark": columns[2]["values"],
    }
    assert sheet.texts == {"state", "remark"}
