"""Commands that make, list and delete the webhooks of a running service, for admins."""

from typing import Annotated

import typer

from jointstiff.service.cli.answers import warn
from jointstiff.service.cli.options import ServerAddress

webhooks = typer.Typer(
    help="Create, list and delete webhooks. JOINTSTIFF_KEY must have an admin key.",
    no_args_is_help=True,
)


@webhooks.command()
def create(
    url: Annotated[str, typer.Argument(metavar="URL", help="Address to post to.")],
    *,
    event: Annotated[
        list[str] | None,
        typer.Option(
            metavar="EVENT",
            help="Event to post: run.succeeded, run.failed, alarm.raised or worker.lost; default: all. "
            "Repeatable.",
        ),
    ] = None,
    server: ServerAddress = "http://127.0.0.1:8000",
) -> None:
    """Create a webhook, and print its secret once; the secret signs the messages."""
    from jointstiff.schemas.webhook import NewWebhook
    from jointstiff.service.library.client import Client, resource_in

    with Client(server) as client:
        document = {"url": url, **({"events": event} if event else {})}
        webhook = resource_in(client.send("POST", "/v1/webhooks", None, document), NewWebhook)
    typer.echo(webhook.secret)
    warn(f"not shown again; to delete the webhook: jointstiff webhooks delete {webhook.id}")


@webhooks.command("list")
def list_webhooks(*, server: ServerAddress = "http://127.0.0.1:8000") -> None:
    """List webhooks and messages that were not delivered."""
    from jointstiff.schemas.webhook import WebhookList
    from jointstiff.service.library.client import Client, resource_in
    from jointstiff.service.tables.table import text_table
    from jointstiff.service.tables.terminal import console, printed

    with Client(server) as client:
        found = resource_in(client.send("GET", "/v1/webhooks"), WebhookList).items
    hooks = [[one.id, one.url, ", ".join(one.events), str(one.delivered)] for one in found]
    lost = [
        [one.url, each.type, each.state, f"{each.created_at:%Y-%m-%d %H:%M}", each.error or "not sent yet"]
        for one in found
        for each in one.undelivered
    ]
    tables = [text_table(["id", "address", "events", "delivered"], hooks, texts=[0, 1, 2])]
    if lost:
        head = ["address", "not delivered", "state", "since (UTC)", "last attempt"]
        tables.append(text_table(head, lost, texts=[0, 1, 2, 3, 4]))
    console().print(printed(tables))


@webhooks.command()
def delete(
    webhook_id: Annotated[str, typer.Argument(metavar="ID", help="Id; see `jointstiff webhooks list`.")],
    *,
    server: ServerAddress = "http://127.0.0.1:8000",
) -> None:
    """Delete a webhook with its messages."""
    from urllib.parse import quote

    from jointstiff.service.library.client import Client

    with Client(server) as client:
        client.send("DELETE", f"/v1/webhooks/{quote(webhook_id, safe='')}")
