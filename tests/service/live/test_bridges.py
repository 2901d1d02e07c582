"""Bridges from trackers to the page: codes, who may use them, and positions that a person sees first."""

import json
import socket
import threading
import time
from datetime import UTC, datetime, timedelta

import pytest
from support.api import post
from support.in_process import Client as InProcess
from support.in_process import served
from support.keyed import KEYS, bearer, opened
from support.live import SIGMA, declared, positions

from jointstiff.service.library.bridge import TrackerBridge
from jointstiff.service.library.client import Client
from jointstiff.service.problems import RefusedError
from jointstiff.service.security.access import FORGIVEN
from jointstiff.service.security.keys import make_key
from jointstiff.service.store.bridges import BRIDGE_LASTS, CODE_LASTS, MOST_BRIDGES
from jointstiff.service.store.store import Store
from jointstiff.service.store.tables import AuditEntry
from jointstiff.simulator import TARGETS, default_arm


class Asking:
    """A client in this process as `support.api.post` uses one, with the key of a role."""

    def __init__(self, client, headers=None):
        self._client, self._headers = client, headers or {}

    def request(self, method, path, headers=None, **options):
        return self._client.request(method, path, headers=self._headers | (headers or {}), **options)

    def post(self, path, **options):
        return self.request("POST", path, **options)

    def get(self, path, **options):
        return self.request("GET", path, **options)

    def put(self, path, **options):
        return self.request("PUT", path, **options)

    def delete(self, path):
        return self.request("DELETE", path)


@pytest.fixture
def store():
    with Store.open("sqlite://") as store:
        yield store


@pytest.fixture
def client(store):
    return Asking(InProcess(store))


def stand(number=1, loaded=False, **changes):
    joints = [0.3, 0.2, -0.4, 0.5, 0.8, -1.0]
    shown = {
        "number": number,
        "label": "m01",
        "joints": joints,
        "force": [0.0, 0.0, -1471.0],
        "loaded": loaded,
        "names": {},
    }
    return shown | changes


def paired(client):
    """Open a set and a bridge to its page, and join; return the addresses of the set and of the bridge."""
    address = declared(client)
    code = client.post(f"{address}/bridge").json()["code"]
    joined = client.post("/v1/bridges", json={"code": code})
    assert joined.status_code == 200, joined.text
    return address, f"/v1/bridges/{joined.json()['id']}"


def test_a_code_joins_once_and_is_stored_as_a_hash(client, store):
    address = declared(client)
    bridge = client.post(f"{address}/bridge").json()
    assert len(bridge["code"].replace("-", "")) == 8
    found = store.bridges.find(bridge["id"], datetime.now(UTC))
    assert bridge["code"].replace("-", "") not in str(found)
    typed = f" {bridge['code'].lower().replace('-', ' ')} "
    first, second = (client.post("/v1/bridges", json={"code": typed}) for _ in range(2))
    assert (first.status_code, first.json()["set_id"]) == (200, address.rpartition("/")[2])
    assert first.json()["code"] is None
    assert (second.status_code, second.json()["detail"]) == (422, "no page shows this code")


def test_codes_differ_and_end(client, store):
    address = declared(client)
    bridges = [client.post(f"{address}/bridge").json() for _ in range(MOST_BRIDGES + 2)]
    assert len({each["code"] for each in bridges}) == len(bridges)
    now = datetime.now(UTC)
    kept = [store.bridges.find(each["id"], now) is not None for each in bridges]
    assert kept == [False, False] + [True] * MOST_BRIDGES
    last = store.bridges.find(bridges[-1]["id"], now)
    assert store.bridges.join(last.code_hash, "", last.created_at + CODE_LASTS) is None
    assert (
        store.bridges.join(last.code_hash, "", last.created_at + CODE_LASTS - timedelta(seconds=1)) == last.id
    )
    assert store.bridges.find(last.id, last.created_at + BRIDGE_LASTS) is None


def test_only_an_open_set_has_a_bridge(client):
    assert client.post("/v1/measurement-sets/none/bridge").status_code == 404
    address, bridge = paired(client)
    state = client.get(f"{address}/next").json()["next"]
    readings = [
        {"target": name, "unloaded": place, "loaded": [place[0], place[1], place[2] - 1e-3]}
        for name, place in zip(
            TARGETS,
            positions(default_arm(), state["joints"], state["force"], sigma=0.0)["unloaded"].tolist(),
            strict=True,
        )
    ]
    fields = {name: state[name] for name in ("label", "joints", "force")}
    post(client, f"{address}/observations", {**fields, "readings": readings})
    assert client.post(f"{bridge}/points", json={}).json() == {"stand": None}
    post(client, f"{address}/close", {}, 200)
    assert client.post(f"{bridge}/points", json={}).status_code == 404
    assert client.post(f"{address}/bridge").status_code == 404


def test_codes_are_not_guessed(client):
    """After too many wrong codes of a network, even the right code waits."""
    code = client.post(f"{declared(client)}/bridge").json()["code"]
    statuses = [
        client.post("/v1/bridges", json={"code": f"WRONG{n}"}).status_code for n in range(FORGIVEN + 3)
    ]
    assert statuses[:FORGIVEN] == [422] * FORGIVEN
    assert statuses[-1] == 429
    assert client.post("/v1/bridges", json={"code": code}).status_code == 429


def test_a_bridge_belongs_to_the_keys_that_opened_and_joined_it(store):
    keyed = opened(store)
    other = make_key("other tablet", "operator", datetime.now(UTC), None)
    store.keys.add(other.record)
    page, terminal = (
        Asking(keyed, bearer("operator")),
        Asking(keyed, {"Authorization": f"Bearer {other.text}"}),
    )
    viewer = Asking(keyed, bearer("viewer"))
    address = declared(page)
    assert viewer.post(f"{address}/bridge").status_code == 403
    opened_bridge = page.post(f"{address}/bridge").json()
    bridge = f"/v1/bridges/{opened_bridge['id']}"
    assert viewer.post("/v1/bridges", json={"code": opened_bridge["code"]}).status_code == 403
    assert terminal.post("/v1/bridges", json={"code": opened_bridge["code"]}).status_code == 200
    assert page.put(f"{bridge}/stand", json=stand()).status_code == 204
    assert terminal.put(f"{bridge}/stand", json=stand()).status_code == 404
    assert terminal.delete(bridge).status_code == 404
    assert terminal.get(bridge).status_code == 404
    assert page.post(f"{bridge}/points", json={}).status_code == 404
    assert terminal.post(f"{bridge}/points", json={}).json()["stand"] == stand()
    assert page.delete(bridge).status_code == 204
    assert terminal.post(f"{bridge}/points", json={}).status_code == 404


def test_the_audit_has_the_pairing_and_not_each_position(store):
    page = Asking(opened(store), bearer("operator"))
    _, bridge = paired(page)
    before = len(store.audit.find())
    assert page.post(f"{bridge}/points", json={}).status_code == 200
    entries: list[AuditEntry] = store.audit.find()
    assert len(entries) == before
    assert {"openBridge", "joinBridge"} <= {each.operation for each in entries}
    assert {each.key_id for each in entries} == {KEYS["operator"].record.id}


@pytest.mark.parametrize(
    ("body", "where"),
    [
        ({"points": {f"P{n}": [0, 0, 0] for n in range(17)}}, "points"),
        ({"points": {"P1": [0.0, 0.0]}}, "points.P1"),
        ({"trouble": "x" * 501}, "trouble"),
        ({"number": -1}, "number"),
        ({"position": [0, 0, 0]}, "position"),
    ],
)
def test_what_is_no_position_is_refused(client, body, where):
    _, bridge = paired(client)
    answer = client.post(f"{bridge}/points", json=body)
    assert (answer.status_code, answer.json()["where"].startswith(where)) == (422, True), answer.text


class Instrument:
    """A tracker that sends a line of each target again and again, over TCP."""

    def __init__(self, names=None):
        self._names = names or {}  # target → its name at the instrument
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.address = f"lines:tcp://127.0.0.1:{self._listener.getsockname()[1]}"
        self.places = {}
        self._thread = threading.Thread(target=self._serve, daemon=True)
        self._thread.start()

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self._thread.join(10.0)
        self._listener.close()

    def _serve(self):
        connection, _ = self._listener.accept()
        with connection:
            try:
                while True:
                    for name, place in self.places.items():
                        sent = self._names.get(name, name)
                        line = f"{sent} {' '.join(repr(1e3 * part) for part in place)}\n"
                        connection.sendall(line.encode())
                    time.sleep(0.05)
            except OSError:
                return


def followed(client, bridge, wanted, seconds=30.0):
    """Follow a bridge until its reading is as wanted; return the reading."""
    deadline = time.monotonic() + seconds
    with client._http.stream("GET", bridge) as answer:
        for line in answer.iter_lines():
            if line.startswith("data: "):
                reading = json.loads(line[6:]).get("reading", {})
                if wanted(reading):
                    return reading
            assert time.monotonic() < deadline, line
    raise AssertionError("the bridge has ended")


def test_a_stream_of_lines_is_read_where_the_page_stands(tmp_path):
    """The unloaded positions, those under the load, a jump that is told, and the end by the page."""
    arm = default_arm()
    with (
        Instrument() as instrument,
        Store.open(f"sqlite:///{tmp_path / 'jointstiff.db'}") as store,
        served(store) as url,
        Client(url) as client,
    ):
        address = declared(client._http)
        opened_bridge = client._http.post(f"{address}/bridge").json()
        bridge = f"/v1/bridges/{opened_bridge['id']}"
        with pytest.raises(RefusedError, match="no page shows this code"):
            TrackerBridge(client, "WRONG", instrument.address)
        joined = TrackerBridge(
            client, opened_bridge["code"], instrument.address, source_options={"sample": False}
        )
        thread = threading.Thread(target=joined.run)
        thread.start()
        planned = client._http.get(f"{address}/next").json()["next"]
        shown = {name: planned[name] for name in ("label", "joints", "force")}
        places = positions(arm, planned["joints"], planned["force"], sigma=0.0)

        def showing(number, loaded):
            answer = client._http.put(f"{bridge}/stand", json=stand(number, loaded, **shown))
            assert answer.status_code == 204, answer.text

        for number, state in enumerate(("unloaded", "loaded"), 1):
            instrument.places = dict(zip(TARGETS, places[state].tolist(), strict=True))
            showing(number, state == "loaded")
            reading = followed(
                client, bridge, lambda got, n=number: got.get("number") == n and len(got["points"]) == 3
            )
            assert reading["trouble"] is None
            for name, place in instrument.places.items():
                assert reading["points"][name] == pytest.approx(place, abs=1e-9)
        instrument.places = {name: [x, y, z + 0.5] for name, (x, y, z) in instrument.places.items()}
        reading = followed(client, bridge, lambda got: got["trouble"] is not None)
        assert "the source has jumped" in reading["trouble"]
        assert reading["points"] == {}
        assert client._http.delete(bridge).status_code == 204
        thread.join(30.0)
        assert not thread.is_alive()
        assert client._http.get(f"{address}/next").json()["readings"] == []  # nobody sent a reading


def test_the_page_is_asked_which_target_an_unknown_name_is(tmp_path):
    """No position is swallowed: the page gets each other name, and names its target or leaves it out."""
    arm, names = default_arm(), {"P11": "SMR-2", "P12": "nest"}
    with (
        Instrument(names) as instrument,
        Store.open(f"sqlite:///{tmp_path / 'jointstiff.db'}") as store,
        served(store) as url,
        Client(url) as client,
    ):
        address = declared(client._http)
        opened_bridge = client._http.post(f"{address}/bridge").json()
        bridge = f"/v1/bridges/{opened_bridge['id']}"
        warnings = []
        joined = TrackerBridge(
            client,
            opened_bridge["code"],
            instrument.address,
            source_options={"sample": False, "warn": warnings.append},
        )
        thread = threading.Thread(target=joined.run)
        thread.start()
        planned = client._http.get(f"{address}/next").json()["next"]
        shown = {name: planned[name] for name in ("label", "joints", "force")}
        places = positions(arm, planned["joints"], planned["force"], sigma=0.0)["unloaded"].tolist()
        instrument.places = dict(zip(TARGETS, places, strict=True))
        client._http.put(f"{bridge}/stand", json=stand(1, **shown))
        reading = followed(client, bridge, lambda got: len(got["unknown"]) == 2)
        assert reading["unknown"]["SMR-2"] == pytest.approx(instrument.places["P11"], abs=1e-9)
        assert list(reading["points"]) in ([], ["P10"])
        client._http.put(f"{bridge}/stand", json=stand(2, **shown, names={"SMR-2": "P11", "nest": None}))
        reading = followed(client, bridge, lambda got: got["number"] == 2 and len(got["points"]) == 2)
        assert reading["points"]["P11"] == pytest.approx(instrument.places["P11"], abs=1e-9)
        assert reading["unknown"] == {}
        client._http.put(f"{bridge}/stand", json=stand(3, **shown, names={"SMR-2": "P11", "nest": "P12"}))
        reading = followed(client, bridge, lambda got: got["number"] == 3 and len(got["points"]) == 3)
        assert reading["points"]["P12"] == pytest.approx(instrument.places["P12"], abs=1e-9)
        assert client._http.delete(bridge).status_code == 204
        thread.join(30.0)
        assert sorted(warnings) == [
            f"{name!r} is no target of this campaign, whose targets are P10, P11, P12"
            for name in ("SMR-2", "nest")
        ]


def test_a_source_that_answers_requests_is_read_in_rounds(tmp_path):
    """A simulated arm, as RoboDK is, answers at once: the page has all targets, again and again."""
    with (
        Store.open(f"sqlite:///{tmp_path / 'jointstiff.db'}") as store,
        served(store) as url,
        Client(url) as client,
    ):
        address = declared(client._http)
        opened_bridge = client._http.post(f"{address}/bridge").json()
        bridge = f"/v1/bridges/{opened_bridge['id']}"
        joined = TrackerBridge(client, opened_bridge["code"], "simulated:3")
        thread = threading.Thread(target=joined.run)
        thread.start()
        assert client._http.put(f"{bridge}/stand", json=stand(7)).status_code == 204
        first = followed(client, bridge, lambda got: got["number"] == 7 and len(got["points"]) == 3)
        second = followed(client, bridge, lambda got: got["points"] != first["points"])
        assert first["points"].keys() == second["points"].keys() == TARGETS.keys()
        for name, place in first["points"].items():
            assert second["points"][name] == pytest.approx(place, abs=12 * SIGMA)
        assert client._http.delete(bridge).status_code == 204
        thread.join(30.0)
        assert not thread.is_alive()
