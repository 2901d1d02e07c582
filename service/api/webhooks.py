"""For admins: webhooks, whose secrets are shown once, and what did not arrive."""

from __future__ import annotations

import json
from datetime import UTC, datetime
from typing import Annotated, Any
from urllib.parse import urlsplit
from uuid import uuid4

from fastapi import APIRouter, HTTPException, Path, Request, Response

from jointstiff.schemas.webhook import Delivery, NewWebhook, Webhook, WebhookList, WebhookRequest
from jointstiff.service.access.addresses import receiver_addresses
from jointstiff.service.access.signing import new_secret
from jointstiff.service.api.access import ADMIN
from jointstiff.service.api.bodies import BodyRoute
from jointstiff.service.api.parts import PartsOf, problems
from jointstiff.service.store.records import WebhookRecord
from jointstiff.service.store.webhooks import MOST
from jointstiff.solver.errors import RequestError

router = APIRouter(prefix="/v1", tags=["webhooks"], route_class=BodyRoute, dependencies=[ADMIN])


@router.post(
    "/webhooks", status_code=201, response_model=NewWebhook, responses=problems(400, 409, 413, 415, 422)
)
def create_webhook(request: Request, parts: PartsOf, body: WebhookRequest) -> NewWebhook:
    """Make a webhook: workers post to its address what happens, signed by Standard Webhooks.

    Its secret is in this answer and nowhere else. An address of this machine, or one that is not public, is
    refused unless the settings allow it.
    """
    if len(parts.store.webhooks.all()) >= MOST:
        raise HTTPException(409, f"there are {MOST} webhooks; delete one first")
    try:
        url = urlsplit(body.url)
        if "@" in url.netloc:
            raise RequestError(
                "the address has a user or a password, which lists would show",
                where="url",
                remedy="omit them: the receiver checks a message by its signature",
            )
        receiver_addresses(url.hostname or "", url.port or (443 if url.scheme == "https" else 80))
    except ValueError as error:
        raise RequestError("this is not an address", where="url", remedy="give https://HOST/PATH") from error
    secret = new_secret()
    record = WebhookRecord(
        id=uuid4().hex,
        url=body.url,
        events=json.dumps(sorted(set(body.events))),
        secret=secret,
        address=str(request.base_url).rstrip("/"),
        created_at=datetime.now(UTC),
    )
    parts.store.webhooks.add(record)
    return NewWebhook(**_described(parts, record), secret=secret)


@router.get("/webhooks", response_model=WebhookList, responses=problems())
def list_webhooks(parts: PartsOf) -> WebhookList:
    """List the webhooks, each with the messages that did not arrive."""
    return WebhookList(items=[Webhook(**_described(parts, one)) for one in parts.store.webhooks.all()])


@router.delete(
    "/webhooks/{webhook_id}", status_code=204, response_class=Response, responses=problems(404, 422)
)
def delete_webhook(parts: PartsOf, webhook_id: Annotated[str, Path(max_length=64)]) -> Response:
    """Delete a webhook with its messages, those that did not arrive, too."""
    parts.store.webhooks.delete(webhook_id)
    return Response(status_code=204)


def _described(parts: PartsOf, record: WebhookRecord) -> dict[str, Any]:
    delivered, rest = parts.store.webhooks.outcome(record.id)
    undelivered = [
        Delivery.model_validate(
            {
                "id": one.message_id,
                "type": one.type,
                "state": one.state,
                "created_at": one.created_at,
                "attempts": one.attempts,
                "next_at": one.due_at,
                "error": one.error,
            }
        )
        for one in rest
    ]
    return {
        "id": record.id,
        "url": record.url,
        "events": json.loads(record.events),
        "created_at": record.created_at,
        "delivered": delivered,
        "undelivered": undelivered,
    }
