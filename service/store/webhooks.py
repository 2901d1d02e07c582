"""Webhooks and the messages to them: written with what happened, claimed and settled by those who send."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Mapping
from dataclasses import asdict, replace
from datetime import datetime, timedelta
from typing import Any, Final

import sqlalchemy as sa

from jointstiff.service.problems import NotFoundError, Resource
from jointstiff.service.store.database import Database, inserting
from jointstiff.service.store.tables import (
    DeliveryRecord,
    WebhookRecord,
    deliveries,
    jobs,
    of_records,
    robots,
    webhooks,
)

WEBHOOK: Final = Resource("webhook", "webhooks")
MOST: Final = 20
"""Webhooks of a service."""
_KEPT: Final = timedelta(days=30)
_AT_ONCE: Final = 50

_HOOKS: Final = of_records(webhooks, WebhookRecord)
_MESSAGES: Final = of_records(deliveries, DeliveryRecord)
_pending: Final = deliveries.c.state == "pending"


class Webhooks:
    """The webhooks of a store. Safe to use from several threads and processes."""

    def __init__(self, database: Database) -> None:
        self._database = database

    def add(self, webhook: WebhookRecord) -> None:
        """Store a webhook."""
        self._database.change(sa.insert(webhooks).values(asdict(webhook)))

    def all(self) -> list[WebhookRecord]:
        """Return all webhooks, in the order in which they came."""
        with self._database.reading() as connection:
            return self._all(connection)

    def delete(self, webhook_id: str) -> None:
        """Remove a webhook with its messages.

        Raises:
            NotFoundError: there is none.
        """
        messages = sa.delete(deliveries).where(deliveries.c.webhook_id == webhook_id)
        if self._database.change(messages, sa.delete(webhooks).where(webhooks.c.id == webhook_id)) == 0:
            raise NotFoundError(WEBHOOK, webhook_id)

    def outcome(self, webhook_id: str) -> tuple[int, list[DeliveryRecord]]:
        """Return how many messages arrived, and the newest that did not."""
        mine = deliveries.c.webhook_id == webhook_id
        with self._database.reading() as connection:
            arrived = sa.select(sa.func.count()).where(mine, deliveries.c.state == "delivered")
            rest = _MESSAGES.where(mine, deliveries.c.state != "delivered", deliveries.c.document != "")
            newest = rest.order_by(deliveries.c.sequence.desc()).limit(_AT_ONCE)
            delivered = connection.execute(arrived).scalar_one()
            return delivered, [DeliveryRecord(*row) for row in connection.execute(newest)]

    def run_ended(self, connection: sa.Connection, run_id: str, now: datetime) -> None:
        """Write the messages about a run in the transaction that ends it; its alarms are derived later."""
        hooks = self._all(connection)
        if not hooks:
            return
        run = jobs.c
        columns = sa.select(run.state, run.verdict, run.robot_id, run.measurement_set_id, robots.c.name)
        row = connection.execute(columns.join_from(jobs, robots, isouter=True).where(run.id == run_id)).one()
        data = {
            "run_id": run_id,
            "verdict": row.verdict,
            "robot": row.name,
            "robot_id": row.robot_id,
            "measurement_set_id": row.measurement_set_id,
        }
        self._tell(connection, hooks, f"run.{row.state}", run_id, run_id, data, now, f"/#/runs/{run_id}")
        if row.state == "succeeded":
            self._tell(connection, hooks, "alarm.raised", run_id, run_id, {}, now)

    def worker_lost(self, worker: str, at: datetime) -> None:
        """Write the messages about a worker that died, once for its last sign of life, whoever tells."""
        with self._database.writing() as connection:
            hooks, key = self._all(connection), f"{worker} {at.isoformat()}"
            self._tell(connection, hooks, "worker.lost", worker, key, {"worker": worker}, at)

    def alarms_raised(
        self, marker: DeliveryRecord, webhook: WebhookRecord, alarms: Mapping[str, Mapping[str, Any]]
    ) -> None:
        """Put the alarms that it was not told of, by their keys, in the place of what a run left for them."""
        with self._database.writing() as connection:
            connection.execute(sa.delete(deliveries).where(self._is(marker)))
            for key, data in alarms.items():
                path = f"/#/compare/trend/{data['robot_id']}"
                now = marker.created_at
                self._tell(connection, [webhook], marker.type, marker.subject, key, data, now, path)

    def due(self, webhook_id: str, now: datetime) -> list[DeliveryRecord]:
        """Return messages to send now, oldest first; of those about one subject the oldest alone."""
        earlier = deliveries.alias()
        behind = sa.exists().where(
            earlier.c.webhook_id == deliveries.c.webhook_id,
            earlier.c.subject == deliveries.c.subject,
            earlier.c.state == "pending",
            earlier.c.sequence < deliveries.c.sequence,
        )
        mine = sa.and_(deliveries.c.webhook_id == webhook_id, _pending, deliveries.c.due_at <= now, ~behind)
        query = _MESSAGES.where(mine).order_by(deliveries.c.sequence).limit(_AT_ONCE)
        return [DeliveryRecord(*row) for row in self._database.rows(query)]

    def claim(self, message: DeliveryRecord, until: datetime) -> DeliveryRecord | None:
        """Take a message to send it; None if somebody else has. It is due again at a time, unless settled."""
        mine = sa.and_(self._is(message), _pending, deliveries.c.due_at == message.due_at)
        claimed = replace(message, attempts=message.attempts + 1, due_at=until)
        taking = sa.update(deliveries).where(mine).values(attempts=claimed.attempts, due_at=until)
        return claimed if self._database.change(taking) == 1 else None

    def settle(self, message: DeliveryRecord, state: str, error: str | None, due_at: datetime) -> None:
        """Write what became of a message that was claimed."""
        mine = sa.and_(self._is(message), deliveries.c.due_at == message.due_at)
        self._database.change(
            sa.update(deliveries).where(mine).values(state=state, error=error, due_at=due_at)
        )

    def forget(self, now: datetime) -> None:
        """Remove messages that are settled and old; those about alarms stay, as none is sent again."""
        old = sa.and_(~_pending, deliveries.c.created_at < now - _KEPT, deliveries.c.type != "alarm.raised")
        self._database.change(sa.delete(deliveries).where(old))

    def _all(self, connection: sa.Connection) -> list[WebhookRecord]:
        query = _HOOKS.order_by(webhooks.c.created_at, webhooks.c.id)
        return [WebhookRecord(*row) for row in connection.execute(query)]

    def _is(self, message: DeliveryRecord) -> sa.ColumnElement[bool]:
        columns = deliveries.c
        return sa.and_(columns.webhook_id == message.webhook_id, columns.message_id == message.message_id)

    def _tell(
        self,
        connection: sa.Connection,
        hooks: Iterable[WebhookRecord],
        event: str,
        subject: str,
        key: str,
        data: Mapping[str, Any],
        now: datetime,
        path: str = "/",
    ) -> None:
        """Write a message to each webhook that asks for the event, unless it was told of it before."""
        identifier = f"msg_{hashlib.sha256(f'{event} {key}'.encode()).hexdigest()[:32]}"
        for hook in hooks:
            if event not in json.loads(hook.events):
                continue
            whole = {
                "type": event,
                "timestamp": now.isoformat(),
                "data": {**data, "link": hook.address + path},
            }
            message = DeliveryRecord(
                webhook_id=hook.id,
                message_id=identifier,
                type=event,
                subject=subject,
                document=json.dumps(whole) if data else "",
                created_at=now,
                state="pending",
                attempts=0,
                due_at=now,
                error=None,
            )
            connection.execute(inserting(connection, deliveries).values(asdict(message)))
