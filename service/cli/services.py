"""Commands that run a service or talk to one."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from jointstiff.service.cli import options as cli
from jointstiff.service.process import LogFormat, set_log_format
from jointstiff.service.settings import DatabaseUrl, LogLines, NoUpgrade, Settings

if TYPE_CHECKING:
    from jointstiff.service.library.client import Client


def serve(**values: Any) -> None:  # noqa: ANN401 - the signature set below has the types
    """Start the service."""
    from jointstiff.service.server import run_server

    run_server(Settings(**values))


cli.set_signature(serve, cli.options_from_settings(Settings))


def worker(
    *,
    database: DatabaseUrl,
    name: Annotated[
        str | None,
        typer.Option(help="Name of this worker in log messages; default: the name of the machine."),
    ] = None,
    log_format: LogLines = LogFormat.TEXT,
    no_upgrade: NoUpgrade = False,
) -> None:
    """Compute the long runs of a service until stopped."""
    import socket

    from jointstiff.service.workers.supervisor import process_name
    from jointstiff.service.workers.worker import run_worker

    set_log_format(log_format)
    executor = process_name(name or socket.gethostname())
    run_worker(database, executor, upgrade=None if no_upgrade else cli.warn)


def status(*, database: DatabaseUrl = "sqlite:///jointstiff.db") -> None:
    """Print workers, queue, and why jobs do not move; exit with status 1 if a job is stuck."""
    from jointstiff.service.problems import StoreUnavailableError
    from jointstiff.service.store.database import open_existing
    from jointstiff.service.store.jobs import SILENT
    from jointstiff.service.store.store import Store

    open_existing(database).close()
    with Store.open(database) as store:
        try:
            store.heartbeats.check_writable()
            unwritable = None
        except StoreUnavailableError as error:
            unwritable = f"the database cannot be written: {error.reason}"
        workers = store.heartbeats.living(SILENT)
        waiting = store.waits.read(unwritable)
    typer.echo(f"workers: {', '.join(workers) or 'none'}")
    typer.echo(f"queue: {waiting.parts} parts of jobs wait, the oldest for {waiting.oldest_seconds:.0f} s")
    for job in waiting.still:
        typer.echo(job.describe())
    if unwritable is not None:
        typer.echo(unwritable)
    if waiting.stuck or unwritable is not None:
        raise typer.Exit(1)


def post(
    file: Annotated[
        Path,
        typer.Argument(metavar="FILE", exists=True, help="File of a campaign, or a folder with such files."),
    ],
    *,
    server: cli.ServerAddress = "http://127.0.0.1:8000",
    unit: cli.Unit = "MNm/rad",
    details: cli.Details = False,
) -> None:
    """Post campaigns to a running service.

    Posting a folder again stores nothing twice. Posting a file again creates a new run, but stores its robot
    and its readings only once. If the service requires a key, set the environment variable JOINTSTIFF_KEY to
    the key.
    """
    from jointstiff.service.kinds.run.kind import RUN
    from jointstiff.service.library.client import Client
    from jointstiff.service.reports.job import lay_out_job
    from jointstiff.service.resources.documents import read_campaign
    from jointstiff.service.tables.terminal import console, progress_bar

    server = server.rstrip("/")
    with Client(server, warn=cli.warn) as client:
        client.ping()
        if file.is_dir():
            raise typer.Exit(_post_all(client, file))
        run = client.post(read_campaign(file))
        set_id = run.request.measurement_set_id
        robot_id = client.measurement_sets.get(set_id).robot_id
        for address in (f"robots/{robot_id}", f"measurement-sets/{set_id}", f"jobs/{run.id}"):
            typer.echo(f"{server}/v1/{address}")
        try:
            with progress_bar(shown=run.progress is not None) as show_progress:
                run = client.runs.wait(run, show_progress)
        except KeyboardInterrupt:
            body = """-H 'Content-Type: application/json' -d '{"cancelled": true}'"""
            cli.warn(f"the run continues; to cancel the run: curl -X PATCH {body} {server}/v1/jobs/{run.id}")
            raise
    console().print(lay_out_job(RUN, run, details=details, unit=unit))
    if run.state != "succeeded":
        raise typer.Exit(1)


def _post_all(client: Client, folder: Path) -> int:
    """Post the campaigns and robots in the JSON files of a folder; return the exit status.

    A file that the service refuses is reported and skipped, and the exit status is 1, otherwise 0.
    """
    from jointstiff.service.problems import ProblemError
    from jointstiff.service.resources.documents import read_object

    refused_files = 0
    for path in sorted(folder.glob("*.json")):
        try:
            document = read_object(path)
            if "measurement_set" in document:
                client.post(document, once=True)
            else:
                client.prepare_robot(document.get("robot", document))
        except ProblemError as error:
            refused_files += 1
            cli.warn(f"{path.name}: {str(error).removeprefix(f'{path}: ')}")
        else:
            typer.echo(path.name)
    return 1 if refused_files else 0
