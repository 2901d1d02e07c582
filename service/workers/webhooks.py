"""Send messages to webhooks: signed, to a checked address, again after longer and longer pauses."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import suppress
from datetime import UTC, datetime, timedelta
from threading import BoundedSemaphore, Thread, Timer
from typing import Any, Final

import httpx2

from jointstiff.schemas.run import Run
from jointstiff.service.kinds.trend import Trends
from jointstiff.service.problems import NotFoundError, Resource
from jointstiff.service.process import jointstiff_version
from jointstiff.service.security.receivers import receiver_addresses, signature
from jointstiff.service.store.store import Store
from jointstiff.service.store.tables import DeliveryRecord, WebhookRecord
from jointstiff.solver.errors import RequestError

_RUNS: Final = Resource(Run.kind, Run.collection)
TIMEOUT_SECONDS: Final = 10.0
_CLAIM: Final = timedelta(minutes=1)  # a message is sent again if whoever sends it has not settled it by then
_FIRST_PAUSE: Final = timedelta(seconds=5)
_LONGEST_PAUSE: Final = timedelta(hours=1)
_GIVEN_UP: Final = timedelta(days=1)
_FORGET: Final = timedelta(hours=1)
_AT_DATABASE: Final = 4
"""Senders that use the database at once, however many wait for their receivers: it has few connections."""


class Sender:
    """Sends what is due, to each webhook in a thread of its own: a slow receiver delays no other.

    Any number may do so: each message is claimed by one of them at a time.
    """

    def __init__(
        self, store: Store, trends: Trends, now: Callable[[], datetime] = lambda: datetime.now(UTC)
    ) -> None:
        self._store, self._trends, self._now = store, trends, now
        self._webhooks = store.webhooks
        self._forgot = datetime.min.replace(tzinfo=UTC)
        self._turns = BoundedSemaphore(_AT_DATABASE)
        self._sending: dict[str, Thread] = {}
        self._failures: list[BaseException] = []

    def look(self) -> None:
        """Begin to send what is due to each webhook to which nothing is being sent.

        Raises:
            StoreUnavailableError: the database does not answer, or did not; look again later.
            MemoryError: a thread had none, now or before.
        """
        hooks = self._webhooks.all()
        # A thread that ended, however it did, is no longer alive: a hook never waits for one.
        self._sending = {name: thread for name, thread in self._sending.items() if thread.is_alive()}
        for hook in hooks:
            if hook.id not in self._sending:
                self._sending[hook.id] = thread = Thread(target=self._send, args=(hook,), daemon=True)
                thread.start()
        if hooks and self._now() - self._forgot > _FORGET:
            self._forgot = self._now()
            self._webhooks.forget(self._forgot)
        self._tell()

    def finish(self) -> None:
        """Return when all that is being sent has ended.

        Raises:
            StoreUnavailableError: the database did not answer.
        """
        while self._sending:
            self._sending.popitem()[1].join()
        self._tell()

    def _tell(self) -> None:
        """Raise what a thread failed on since the last look, a want of memory first."""
        failures, self._failures = self._failures, []
        for failure in sorted(failures, key=lambda failure: not isinstance(failure, MemoryError)):
            raise failure

    def _send(self, webhook: WebhookRecord) -> None:
        try:
            self._send_due(webhook)
        except BaseException as failure:  # noqa: BLE001 - raised again by the next look
            self._failures.append(failure)

    def _send_due(self, webhook: WebhookRecord) -> None:
        """Send the messages of a webhook in order, until one gets no answer: the others wait as well."""
        with self._turns:
            messages = self._webhooks.due(webhook.id, self._now())
        for due in messages:
            with self._turns:
                message = self._webhooks.claim(due, self._now() + _CLAIM)
                if message is None:
                    continue
                if not message.document:
                    self._webhooks.alarms_raised(message, webhook, self._alarms(message.subject))
                    continue
            error: str | None
            try:
                status = self._post(webhook, message)
                error = None if 200 <= status < 300 else f"answered {status}"
            except (RequestError, httpx2.HTTPError, httpx2.InvalidURL) as failure:
                status, error = 0, str(failure)[:200] or type(failure).__name__
            with self._turns:
                now = self._now()
                if error is None:
                    self._webhooks.settle(message, "delivered", None, now)
                elif now - message.created_at >= _GIVEN_UP:
                    self._webhooks.settle(message, "dead", error, now)
                else:
                    pause = min(_FIRST_PAUSE * 2 ** min(message.attempts - 1, 20), _LONGEST_PAUSE)
                    self._webhooks.settle(message, "pending", error, now + pause)
            if status == 0:
                return

    def _post(self, webhook: WebhookRecord, message: DeliveryRecord) -> int:
        """Post a message to an address that was checked; return the status of the answer.

        Raises:
            RequestError: the receiver has no address that may be asked.
            HTTPError: there is no answer.
        """
        url = httpx2.URL(webhook.url)
        timestamp = int(self._now().timestamp())
        request: dict[str, Any] = {
            "content": message.document,
            "headers": {
                "Host": url.netloc.decode("ascii"),
                "Content-Type": "application/json",
                "User-Agent": f"Jointstiff/{jointstiff_version()}",
                "webhook-id": message.message_id,
                "webhook-timestamp": str(timestamp),
                "webhook-signature": signature(
                    webhook.secret, message.message_id, timestamp, message.document
                ),
            },
            "extensions": {"sni_hostname": url.host},  # the certificate is that of the name
        }
        *others, last = receiver_addresses(url.host, url.port)
        with httpx2.Client(trust_env=False, follow_redirects=False, timeout=TIMEOUT_SECONDS) as client:
            for address in others:
                with suppress(httpx2.ConnectError, httpx2.ConnectTimeout):
                    return _status(client, url.copy_with(host=address), request)
            return _status(client, url.copy_with(host=last), request)

    def _alarms(self, run_id: str) -> dict[str, dict[str, Any]]:
        """Return what is to be told of the alarms of a run's robot, by what tells alarms apart."""
        runs, alarms = self._store.jobs(_RUNS), {}
        with suppress(NotFoundError):  # a run or its robot was deleted meanwhile
            robot = self._store.robots.get(runs.get(run_id).robot_id or "")
            for alarm in self._trends.alarms([robot.id]).get(robot.id, []):
                alarms[f"{alarm.measurement_set_id} {alarm.joint}"] = {
                    "run_id": alarm.run_id,  # which raised it; others may have ended since
                    "verdict": runs.get(alarm.run_id).verdict,
                    "robot": robot.name,
                    "robot_id": robot.id,
                    "alarm": alarm.model_dump(mode="json"),
                }
        return alarms


def _status(client: httpx2.Client, url: httpx2.URL, request: Mapping[str, Any]) -> int:
    end = Timer(TIMEOUT_SECONDS, client.close)  # the client's own time limit is for each read
    end.start()
    try:
        with client.stream("POST", url, **request) as answer:  # its body is not read
            return answer.status_code
    except httpx2.HTTPError as failure:
        if end.finished.is_set():
            raise httpx2.ReadTimeout("timed out") from failure
        raise
    finally:
        end.cancel()
