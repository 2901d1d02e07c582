"""Webhooks: addresses that are told of events, and the messages that did not arrive."""

from __future__ import annotations

from typing import Annotated, Literal, get_args

from pydantic import Field

from jointstiff.schemas.fields import Identifier, Message, Timestamp

Event = Literal["run.succeeded", "run.failed", "alarm.raised", "worker.lost"]
Events = Annotated[list[Event], Field(min_length=1, max_length=len(get_args(Event)))]


class WebhookRequest(Message):
    """A webhook as it is posted."""

    url: Annotated[str, Field(max_length=2_000, pattern=r"^https?://[!-~]+$")] = Field(
        description="Address to post to, without user and password; redirects are not followed.",
        examples=["https://mes.example/hooks"],
    )
    events: Events = Field(default=list(get_args(Event)), description="Events to post; default: all.")


class Delivery(Message):
    """A message to a webhook that was not delivered."""

    id: str = Field(description="Id of the message, the same at each attempt (`webhook-id`).")
    type: Event
    state: Literal["pending", "dead"] = Field(
        description="`dead`: it was not delivered within a day, and is not sent again."
    )
    created_at: Timestamp
    attempts: int = Field(description="Number of attempts so far.")
    next_at: Timestamp = Field(description="Time of the next attempt, or of the last one.")
    error: str | None = Field(description="Outcome of the latest attempt; null before the first.")


class Webhook(Message):
    """A webhook, without its secret."""

    id: Identifier
    url: str = Field(description="Address to post to.")
    events: Events
    created_at: Timestamp
    delivered: int = Field(description="Number of messages delivered in the last 30 days.")
    undelivered: list[Delivery] = Field(
        description="Newest 50 messages that were not delivered, newest first."
    )


class WebhookList(Message):
    """All webhooks."""

    items: list[Webhook] = Field(description="Webhooks in order of creation.")


class NewWebhook(Webhook):
    """A new webhook with its secret, which is not shown again."""

    secret: str = Field(description="Secret that signs its messages (`whsec_…`). It is not shown again.")
