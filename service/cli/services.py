"""Commands that run a service or talk to one: `serve`, `worker`, `post`, `demo`."""

from __future__ import annotations

import os
import secrets
import socket
from typing import Annotated

import typer

from jointstiff.service.cli.answers import failed, refused, warn
from jointstiff.service.cli.demo import run_demo
from jointstiff.service.cli.options import CampaignFile, DatabaseUrl
from jointstiff.service.library import CampaignError, Client, RefusedError, TabledRun, read_campaign
from jointstiff.service.render import console, progress_bar, run_report
from jointstiff.service.server import ServerError, run_server
from jointstiff.service.store import StoreError
from jointstiff.service.workers import run_worker


def serve(
    *,
    host: Annotated[str, typer.Option(help="Address to listen on.")] = "127.0.0.1",
    port: Annotated[int, typer.Option(min=0, max=65535, help="Port; 0 takes a free one.")] = 8000,
    database: DatabaseUrl = "sqlite:///jointstiff.db",
    workers: Annotated[
        int, typer.Option(min=0, max=64, help="Processes for long runs; 0 leaves them to other machines.")
    ] = 1,
) -> None:
    """Start the service."""
    try:
        run_server(host, port, database, workers)
    except (StoreError, ServerError) as error:
        raise failed(error.reason, error.remedy) from error


def worker(
    *,
    database: DatabaseUrl,
    name: Annotated[
        str | None, typer.Option(help="Of this worker; one of the same name takes over what it leaves.")
    ] = None,
) -> None:
    """Carry out the long runs of a service, on this or another machine, until stopped."""
    try:
        run_worker(database, name or f"{socket.gethostname()}-{os.getpid()}-{secrets.token_hex(4)}")
    except StoreError as error:
        raise failed(error.reason, error.remedy) from error


def post(
    file: CampaignFile,
    *,
    server: Annotated[
        str, typer.Option(envvar="JOINTSTIFF_SERVER", metavar="ADDRESS", help="Of a running service.")
    ] = "http://127.0.0.1:8000",
) -> None:
    """Post a campaign to a running service, and show its answer."""
    try:
        campaign = read_campaign(file).model_dump(mode="json", exclude_unset=True)
        with Client(server, warn=warn) as client:
            client.ping()
            robot, stored = client.post_campaign(campaign)
            run = client.runs.create(campaign.get("run", {}) | {"measurement_set_id": stored.id})
            posted = (("robots", robot.id), ("measurement-sets", stored.id), ("runs", run.id))
            addresses = [f"{server.rstrip('/')}/v1/{kind}/{identifier}" for kind, identifier in posted]
            for address in addresses:
                console().print(address, markup=False, soft_wrap=True)
            run = _ended(client, run, addresses[-1])
    except (CampaignError, RefusedError) as error:
        raise refused(error.problem) from error
    console().print(run_report(run))
    if run.state != "succeeded":
        raise typer.Exit(1)


def _ended(client: Client, run: TabledRun, address: str) -> TabledRun:
    """Wait for the end of a run; who waits no longer is told that it goes on."""
    try:
        with progress_bar(shown=run.progress is not None) as tell:
            return client.runs.wait(run, tell)
    except KeyboardInterrupt:
        warn(f"the run goes on; to end it: curl -X POST {address}/cancel")
        raise


def demo(
    *,
    once: Annotated[bool, typer.Option("--once", help="End after the tables.")] = False,
    port: Annotated[
        int | None, typer.Option(min=0, max=65535, help="8000, or any free one with --once.")
    ] = None,
    database: DatabaseUrl = "sqlite:///jointstiff.db",
) -> None:
    """Start the service, post an example campaign over HTTP, and show what it answers."""
    raise typer.Exit(run_demo(port=_demo_port(port, once=once), database=database, once=once))


def _demo_port(port: int | None, *, once: bool) -> int:
    if port is not None:
        return port
    return 0 if once else 8000
