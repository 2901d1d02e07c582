"""Webhooks: signed messages, each at least once, in order for a job, the same id at each attempt."""

import hashlib
import hmac
import json
import socket
import threading
import time
from base64 import b64decode, b64encode
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

import httpx2
import pytest
from support import api
from support.in_process import Client
from support.jobs import run_request, runs_of, stored_set
from support.processes import Service, until

from jointstiff.service.jobs import Parts
from jointstiff.service.security.admission import Posture
from jointstiff.service.security.keys import mint
from jointstiff.service.security.receivers import ALLOWED_VARIABLE, signature
from jointstiff.service.server import forgetting
from jointstiff.service.store.store import Store
from jointstiff.service.workers import webhooks
from jointstiff.service.workers.webhooks import Sender
from jointstiff.simulator import default_arm, simulate_campaign


class Receiver:
    """A real receiver, which notes what comes, and answers as it is told."""

    def __init__(self):
        self.came = []
        self.answers = {}  # status by the number of the request
        self.location = None
        self.pause = 0.0
        self.drips = 0
        receiver = self

        class Handler(BaseHTTPRequestHandler):
            def do_POST(self):
                body = self.rfile.read(int(self.headers["Content-Length"])).decode()
                receiver.came.append((dict(self.headers), body))
                time.sleep(receiver.pause)
                while receiver.drips:
                    time.sleep(0.05)
                    self.wfile.write(
                        b"HTTP/1.1 204 No Content\r\n" if receiver.drips == 1 else b"X-More: 1\r\n"
                    )
                    self.wfile.flush()
                    receiver.drips += 1
                self.send_response(receiver.answers.get(len(receiver.came), 204))
                if receiver.location:
                    self.send_header("Location", receiver.location)
                self.end_headers()

            def log_message(self, *_):
                pass

        self._handler = Handler
        with socket.create_server(("127.0.0.1", 0)) as free:
            self.port = free.getsockname()[1]
        self.url = f"http://127.0.0.1:{self.port}/hooks"

    @contextmanager
    def up(self):
        with ThreadingHTTPServer(("127.0.0.1", self.port), self._handler) as server:
            threading.Thread(target=server.serve_forever, args=(0.01,), daemon=True).start()
            try:
                yield self
            finally:
                server.shutdown()

    @property
    def messages(self):
        return [json.loads(body) for _, body in self.came]

    @property
    def ids(self):
        return [headers["webhook-id"] for headers, _ in self.came]


class Clock:
    """A clock that is set by hand, from the moment on at which it is made."""

    def __init__(self):
        self.time = datetime.now(UTC) + timedelta(seconds=1)

    def __call__(self):
        return self.time

    def go_on(self, **step):
        self.time += timedelta(**step)


@pytest.fixture
def receiver():
    return Receiver()


@pytest.fixture
def clock():
    return Clock()


@pytest.fixture(autouse=True)
def allowed(monkeypatch):
    monkeypatch.setenv(ALLOWED_VARIABLE, "127.0.0.1, ::1")


ADMIN = mint("admin Smith", "admin", datetime.now(UTC), None)


CLIENTS = {}


def ask(store, method, path, **options):
    """Ask as an admin."""
    if store not in CLIENTS:
        store.keys.add(ADMIN.record)
        CLIENTS.clear()
        CLIENTS[store] = Client(store, Posture.of("127.0.0.1", (), access_control=True, require_key=True))
    headers = {"Authorization": f"Bearer {ADMIN.text}"}
    return CLIENTS[store].request(method, path, headers=headers, **options)


def told_of(store, receiver, **body):
    answer = ask(store, "POST", "/v1/webhooks", json={"url": receiver.url} | body)
    assert answer.status_code == 201, answer.text
    return answer.json()


def outcome(store):
    (hook,) = ask(store, "GET", "/v1/webhooks").json()["items"]
    return hook


class Patient(Sender):
    """Looks, and waits until all that was due is sent."""

    def look(self):
        super().look()
        self.finish()


def sender_of(store, clock, kind=Patient):
    clock.time = max(clock.time, datetime.now(UTC) + timedelta(seconds=1))
    return kind(store, Parts(store).trends, clock)


def run(store, set_id):
    return runs_of(store).create(run_request(set_id, resampling=None), None)


def due(store, receiver, clock, kind=Patient):
    """A sender that has to tell a receiver of one run."""
    told_of(store, receiver, events=["run.succeeded"])
    run(store, stored_set(store))
    return sender_of(store, clock, kind)


def looks(sender, clock, **total):
    """Look every second of a time, jumping to what is due."""
    end = clock.time + timedelta(**total)
    while clock.time < end:
        sender.look()
        clock.go_on(seconds=1)


def test_the_signature_is_that_of_the_published_example():
    """Standard Webhooks, its reference libraries' test."""
    secret, message = "whsec_MfKQ9r8GKYqrTwjUPD8ILPZIo2LaLaSw", "msg_p5jXN8AQM9LWM0D4loKWxJek"
    signed = signature(secret, message, 1614265330, '{"test": 2432232314}')
    assert signed == "v1,g0hM9SsE+OTPJTGt/tmIKtSyZlE3uFJELVlNIOLJ1OE="


def test_a_receiver_that_is_down_ten_minutes_gets_everything_once_and_in_order(database_url, receiver, clock):
    with Store.open(database_url) as store:
        made = told_of(store, receiver)
        set_id = stored_set(store)
        runs = [run(store, set_id) for _ in range(3)]
        sender = sender_of(store, clock)
        for _ in range(60):
            sender.look()
            clock.go_on(seconds=10)
        pending = outcome(store)["undelivered"]
        assert {one["state"] for one in pending} == {"pending"}
        assert max(one["attempts"] for one in pending) > 3
        assert "refused" in pending[-1]["error"]
        with receiver.up():
            for _ in range(70):
                sender.look()
                clock.go_on(seconds=10)
        assert outcome(store)["undelivered"] == []
        assert outcome(store)["delivered"] == 3
    assert len(receiver.ids) == len(set(receiver.ids)) == 3
    assert [one["data"]["run_id"] for one in receiver.messages] == [one.id for one in runs]
    for (headers, body), message in zip(receiver.came, receiver.messages, strict=True):
        signed = f"{headers['webhook-id']}.{headers['webhook-timestamp']}.{body}".encode()
        key = b64decode(made["secret"].removeprefix("whsec_"))
        expected = b64encode(hmac.new(key, signed, hashlib.sha256).digest()).decode()
        assert headers["webhook-signature"] == f"v1,{expected}"
        assert message["type"] == "run.succeeded"
        data = message["data"]
        assert data["link"] == f"http://localhost:8000/#/runs/{data['run_id']}"
        assert data["verdict"] in {"use", "use_with_care"}
        assert data["robot"]


def test_a_receiver_that_answers_500_or_redirects_gets_the_same_id_again(store, receiver, clock):
    sender = due(store, receiver, clock)
    receiver.answers = {1: 500, 2: 503, 3: 302}
    receiver.location = f"http://127.0.0.1:{receiver.port}/elsewhere"
    with receiver.up():
        sender.look()
        assert outcome(store)["undelivered"][0]["error"] == "answered 500"
        sender.look()
        assert len(receiver.came) == 1  # not before the pause is over
        looks(sender, clock, minutes=1)
    assert len(receiver.came) == 4  # 5, 10 and 20 s later; no redirect was followed
    assert len(set(receiver.ids)) == 1
    assert outcome(store)["delivered"] == 1


def test_a_slow_receiver_and_a_sender_that_is_killed_repeat_the_same_id(store, receiver, clock, monkeypatch):
    sender = due(store, receiver, clock)
    with receiver.up():
        receiver.pause = 2.0
        with monkeypatch.context() as impatient:
            impatient.setattr(webhooks, "TIMEOUT_SECONDS", 0.5)
            sender.look()
        assert "timed out" in outcome(store)["undelivered"][0]["error"]
        until(lambda: len(receiver.came) == 1)
        receiver.pause = 0.0
        clock.go_on(seconds=5)
        with monkeypatch.context() as killed:
            killed.setattr(store.webhooks, "settle", lambda *_: (_ for _ in ()).throw(KeyboardInterrupt))
            with pytest.raises(KeyboardInterrupt):
                sender.look()
        assert len(receiver.came) == 2
        another = sender_of(store, clock)
        another.look()
        assert len(receiver.came) == 2  # it may be under way
        clock.go_on(minutes=1)
        another.look()
        another.look()
    assert len(receiver.came) == 3
    assert len(set(receiver.ids)) == 1
    assert outcome(store)["delivered"] == 1


@pytest.mark.process
def test_a_service_killed_between_writing_and_sending_sends_it_when_it_is_back(tmp_path, receiver):
    database = f"sqlite:///{tmp_path / 'store.db'}"
    header = {"Authorization": f"Bearer {ADMIN.text}"}
    campaign = simulate_campaign(default_arm(), load="pull", configurations=10)
    with Store.open(database) as store:
        told_of(store, receiver, events=["run.succeeded"])
        service = Service(database, "--workers", "0")  # nobody sends
        with httpx2.Client(base_url=service.url, headers=header, timeout=30) as client:
            made = api.stored_set(client, campaign)["id"]
            runs = [client.post("/v1/runs", json={"measurement_set_id": made}).json()["id"] for _ in range(2)]
        service.process.kill()
        service.stop()
        written = [one["id"] for one in outcome(store)["undelivered"]]
        assert receiver.came == []
        with receiver.up():
            service = Service(database, "--workers", "1")
            try:
                until(lambda: outcome(store)["delivered"] == 2)
            finally:
                service.stop()
    assert receiver.ids == written[::-1]
    assert [one["data"]["run_id"] for one in receiver.messages] == runs


def test_a_slow_receiver_delays_no_other(store, clock):
    """Ten messages of ten seconds each are due to one; another one is told of the next run at once."""
    slow, prompt = Receiver(), Receiver()
    passed, arrived = threading.Condition(), []

    class Simulated(Sender):
        """A sender whose slow receiver takes ten seconds of the clock for each message."""

        takes = timedelta(seconds=10)

        def _post(self, webhook, message):
            if webhook.url == slow.url:
                began = clock()
                with passed:
                    passed.wait_for(lambda: clock() - began >= self.takes)
            arrived.append((webhook.url, message.subject, clock()))
            return 204

    set_id = stored_set(store)
    told_of(store, slow, events=["run.succeeded"])
    for _ in range(10):
        run(store, set_id)
    told_of(store, prompt, events=["run.succeeded"])
    sender = sender_of(store, clock, Simulated)
    sender.look()
    last = run(store, set_id)
    began = clock.time = max(clock.time, datetime.now(UTC)) + timedelta(seconds=1)
    sender.look()
    until(lambda: len(arrived) > 0)
    ((url, subject, at),) = arrived
    assert (url, subject) == (prompt.url, last.id)
    assert at - began <= timedelta(seconds=2)
    Simulated.takes = timedelta(0)
    with passed:
        passed.notify_all()
    sender.finish()
    sender.look()
    sender.finish()
    assert len(arrived) == 12


def test_what_a_thread_without_memory_left_is_sent_at_the_next_look(store, receiver, clock):
    class Short(Patient):
        short = True

        def _send_due(self, webhook):
            if self.short:
                raise MemoryError
            super()._send_due(webhook)

    sender = due(store, receiver, clock, Short)
    with pytest.raises(MemoryError):  # a worker ends then, and its supervisor starts another one
        sender.look()
    sender.short = False
    with receiver.up():
        sender.look()
    assert len(receiver.came) == 1


def test_few_senders_use_the_database_at_once_however_many_receivers(store, clock, monkeypatch):
    receivers = [Receiver() for _ in range(20)]
    for each in receivers:
        told_of(store, each, events=["run.succeeded"])
    run(store, stored_set(store))
    at_once, most, lock = 0, 0, threading.Lock()

    def counting(method):
        def counted(*args):
            nonlocal at_once, most
            with lock:
                at_once, most = at_once + 1, max(most, at_once + 1)
            try:
                time.sleep(0.002)
                return method(*args)
            finally:
                with lock:
                    at_once -= 1

        return counted

    for name in ("due", "claim", "settle"):
        monkeypatch.setattr(store.webhooks, name, counting(getattr(store.webhooks, name)))
    sender_of(store, clock).look()
    assert 1 < most <= 4


def test_an_answer_that_drips_has_its_time_as_a_whole(store, receiver, clock, monkeypatch):
    sender = due(store, receiver, clock)
    monkeypatch.setattr(webhooks, "TIMEOUT_SECONDS", 2.0)
    receiver.drips = 1
    with receiver.up():
        sender.look()
        assert 3 < receiver.drips < 100
        assert "timed out" in outcome(store)["undelivered"][0]["error"]
        receiver.drips = 0


def test_a_lost_worker_is_told_once_by_two_who_see_it_at_one_instant(database_url, receiver):
    """Two workers of two processes, and the service that held the one that died."""
    with Store.open(database_url) as first, Store.open(database_url) as second:
        told_of(first, receiver, events=["worker.lost"])
        for name in ("one", "two", "three"):
            first.heartbeats.beat(name)
            (seen,) = {store.heartbeats.silent(timedelta(seconds=-9))[name] for store in (first, second)}
            together = threading.Barrier(2)

            def tell(store, name=name, seen=seen, together=together):
                together.wait()
                store.webhooks.worker_lost(name, seen)

            with ThreadPoolExecutor(2) as threads:
                list(threads.map(tell, (first, second)))
            forgetting(second)(name)
            forgetting(second)(name)  # it left before its process ended
        told = outcome(first)["undelivered"]
    assert len(told) == 3


def test_an_alarm_is_told_once_after_the_run_that_raised_it(store, receiver, clock):
    client, arm = Client(store), default_arm()
    soft = replace(arm, stiffnesses=arm.stiffnesses * [1, 1, 0.85, 1, 1, 1])
    campaigns = [
        simulate_campaign(each, load="pull", configurations=10, seed=seed)
        for seed, each in enumerate([arm, arm, arm, soft, soft])
    ]
    told_of(store, receiver, events=["run.succeeded", "alarm.raised"])
    robot = client.request("POST", "/v1/robots", json=campaigns[0]["robot"]).json()["id"]
    runs = []
    with receiver.up():
        sender = sender_of(store, clock)
        for month, campaign in enumerate(campaigns, 1):
            noted = {"robot_id": robot, "measured_at": f"2026-{month:02d}-10T08:00:00Z", "serial_number": "W"}
            body = campaign["measurement_set"] | noted
            posted = client.request("POST", "/v1/measurement-sets", json=body).json()["id"]
            for _ in range(2 if month == 4 else 1):  # the run that raises it is repeated
                runs.append(
                    client.request("POST", "/v1/runs", json={"measurement_set_id": posted}).json()["id"]
                )
                clock.time = datetime.now(UTC) + timedelta(seconds=1)
                looks(sender, clock, seconds=3)
    assert [one["type"] for one in receiver.messages].count("alarm.raised") == 1
    kinds = [(one["type"], one["data"]["run_id"]) for one in receiver.messages]
    assert kinds[3:5] == [("run.succeeded", runs[3]), ("alarm.raised", runs[3])]
    alarm = receiver.messages[4]["data"]
    assert alarm["alarm"]["joint"] == "joint_3"
    assert alarm["alarm"]["serial_number"] == "W"
    assert alarm["link"].endswith(f"/#/compare/trend/{robot}")
    assert len(set(receiver.ids)) == len(runs) + 1


def resolve(monkeypatch, *addresses):
    """Let every name have these addresses."""
    found = [(socket.AF_INET, socket.SOCK_STREAM, 6, "", (one, 80)) for one in addresses]
    monkeypatch.setattr("jointstiff.service.security.receivers.socket.getaddrinfo", lambda *_, **__: found)


def test_a_name_that_leads_elsewhere_later_leads_nowhere(store, receiver, clock, monkeypatch):
    """DNS rebinding: public when it is made, this machine when the message is sent; or both at once."""
    monkeypatch.delenv(ALLOWED_VARIABLE)
    with monkeypatch.context() as resolving:
        resolve(resolving, "1.1.1.1")
        receiver.url = f"http://rebinding.example:{receiver.port}/"
        told_of(store, receiver, events=["run.succeeded"])
        run(store, stored_set(store))
        resolve(resolving, "1.1.1.1", "127.0.0.1")
        with receiver.up():
            sender_of(store, clock).look()
        both = ask(store, "POST", "/v1/webhooks", json={"url": receiver.url})
    assert both.status_code == 422
    assert receiver.came == []
    assert "is 127.0.0.1" in outcome(store)["undelivered"][0]["error"]
