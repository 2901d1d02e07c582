"""The command line: `jointstiff`."""

from __future__ import annotations

import json
import os
import secrets
import socket
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated

import typer
from pydantic import ValidationError

from examples.simulator import default_arm, simulate_campaign
from schemas.resampling import MAX_REPETITIONS
from schemas.run import RunOptions
from service import campaigns
from service.campaigns import CampaignError, read_campaign
from service.cli_options import (
    AsJson,
    CampaignFile,
    DatabaseUrl,
    EncoderChoice,
    LoadChoice,
    MethodChoice,
    WeightingChoice,
)
from service.client import RefusedError, ServiceClient
from service.demo import run_demo
from service.problems import invalid_request
from service.server import ServerError, run_server
from service.store_errors import StoreError
from service.terminal import comparison_table, console, problem_text, progress_bar, run_report
from service.versions import JOINTSTIFF_VERSION
from service.worker import run_worker

__all__ = ["main"]

app = typer.Typer(
    name="jointstiff",
    help="Identify the joint stiffness of industrial robots from laser-tracker readings.\n\n"
    "Start with [bold]jointstiff simulate campaign.json[/], then "
    "[bold]jointstiff identify campaign.json[/].",
    no_args_is_help=True,
    add_completion=False,
    rich_markup_mode="rich",
    pretty_exceptions_enable=False,
)


@app.command()
def identify(
    file: CampaignFile,
    *,
    method: Annotated[MethodChoice | None, typer.Option(help="Instead of the file's.")] = None,
    weighting: Annotated[WeightingChoice | None, typer.Option(help="Instead of the file's.")] = None,
    characteristic_length: Annotated[
        float | None,
        typer.Option(metavar="METRES", help="For that weighting; least condition number if absent."),
    ] = None,
    positive: Annotated[
        bool | None,
        typer.Option("--positive/--unconstrained", help="Compliance zero or positive, or free."),
    ] = None,
    confidence: Annotated[
        float | None, typer.Option(min=0.5, max=0.9999, help="Level of the intervals.")
    ] = None,
    resample: Annotated[
        int | None,
        typer.Option(min=1, metavar="M", help="Repeat the fit on M random configurations."),
    ] = None,
    repetitions: Annotated[int, typer.Option(min=1, max=MAX_REPETITIONS, help="How many draws.")] = 1000,
    seed: Annotated[int, typer.Option(min=0, help="Of the draws.")] = 0,
    as_json: AsJson = False,
) -> None:
    """Identify the joint stiffnesses of a campaign, without a server."""
    chosen = {
        "method": method,
        "weighting": weighting,
        "characteristic_length": characteristic_length,
        "positive": positive,
        "confidence": confidence,
        "resampling": resample and {"size": resample, "repetitions": repetitions, "seed": seed},
    }
    changes = {name: value for name, value in chosen.items() if value is not None}
    try:
        campaign = read_campaign(file)
        options = _changed(campaign.run, changes)
        with progress_bar(options.resampling.repetitions if options.resampling else None) as tell:
            run = campaigns.identify(campaign, options, tell)
    except CampaignError as error:
        raise _refused(error) from error
    if as_json:
        typer.echo(run.model_dump_json(indent=2))
    else:
        console().print(run_report(run))
    if run.state != "succeeded":
        raise typer.Exit(1)


@app.command()
def compare(file: CampaignFile, *, as_json: AsJson = False) -> None:
    """Compare the three methods on a campaign, unconstrained and constrained."""
    try:
        rows = campaigns.compare(read_campaign(file))
    except CampaignError as error:
        raise _refused(error) from error
    if as_json:
        dumped = [row.outcome.model_dump(mode="json") for row in rows]
        typer.echo(json.dumps(dumped, indent=2))
        return
    console().print(comparison_table(rows))


@app.command()
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
        raise _failed(error.reason, error.remedy) from error


@app.command()
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
        raise _failed(error.reason, error.remedy) from error


@app.command()
def simulate(
    file: Annotated[Path, typer.Argument(dir_okay=False, metavar="FILE", help="Where to write it.")],
    *,
    load: Annotated[
        LoadChoice, typer.Option(help="Weight on the flange, or pulls all around.")
    ] = LoadChoice.PULL,
    configurations: Annotated[int, typer.Option(min=1, max=5_000, help="How many postures.")] = 19,
    force: Annotated[float, typer.Option(min=0.0, max=1e5, help="Size of the force, in newtons.")] = 1500.0,
    sigma: Annotated[float, typer.Option(min=0.0, max=1e-2, help="Noise of a coordinate, in metres.")] = 2e-5,
    encoders: Annotated[
        EncoderChoice, typer.Option(help="Which close the position loop.")
    ] = EncoderChoice.MOTOR,
    seed: Annotated[int, typer.Option(min=0, help="The same seed gives the same file.")] = 1,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace an existing file.")] = False,
) -> None:
    """Write an example campaign, made by springs that balance the load exactly."""
    if file.exists() and not overwrite:
        console(stderr=True).print(
            f"{file} exists\n  remedy: choose another name, or --overwrite", style="red"
        )
        raise typer.Exit(2)
    arm = default_arm(encoders.value)
    document = simulate_campaign(
        arm,
        configurations=configurations,
        load=load.value,
        force=force,
        sigma=sigma,
        encoders=encoders.value,
        seed=seed,
    )
    try:
        file.write_text(json.dumps(document, indent=1) + "\n", encoding="utf-8")
    except OSError as error:
        raise _failed(f"cannot write {file}: {error.strerror}", "choose another place") from error
    stiffness = ", ".join(f"{1e-6 * k:.3g}" for k in arm.stiffnesses)
    console().print(
        f"wrote {file}: {configurations} configurations, {force:g} N\n"
        f"true stiffnesses, joint 1 to {len(arm.stiffnesses)}: {stiffness} × 10⁶ N·m/rad\n"
        f"now: jointstiff identify {file}",
        markup=False,
        soft_wrap=True,
    )


@app.command()
def post(
    file: CampaignFile,
    *,
    server: Annotated[
        str, typer.Option(envvar="JOINTSTIFF_SERVER", metavar="ADDRESS", help="Of a running service.")
    ] = "http://127.0.0.1:8000",
) -> None:
    """Post a campaign to a running service, and show its answer."""
    try:
        understood = read_campaign(file)
        campaign = understood.model_dump(mode="json", exclude_unset=True)
        resampling = understood.run.resampling
        with ServiceClient(server) as client:
            robot, stored = client.post_campaign(campaign)
            with progress_bar(resampling.repetitions if resampling else None) as tell:
                options = campaign.get("run", {})
                run = client.run(stored["id"], options, lambda progress: tell(progress.done))
    except (CampaignError, RefusedError) as error:
        raise _refused(error) from error
    for kind, identifier in (("robots", robot["id"]), ("measurement-sets", stored["id"]), ("runs", run.id)):
        console().print(f"{server.rstrip('/')}/v1/{kind}/{identifier}", markup=False, soft_wrap=True)
    console().print(run_report(run))


@app.command()
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


def _changed(options: RunOptions, changes: Mapping[str, object]) -> RunOptions:
    try:
        return RunOptions.model_validate({**options.model_dump(), **changes})
    except ValidationError as error:
        raise CampaignError(invalid_request(error.errors())) from None


def _failed(reason: str, remedy: str) -> typer.Exit:
    console(stderr=True).print(f"{reason}\n  remedy: {remedy}", style="red", markup=False, soft_wrap=True)
    return typer.Exit(2)


def _refused(error: CampaignError | RefusedError) -> typer.Exit:
    console(stderr=True).print(problem_text(error.problem))
    return typer.Exit(2)


def _demo_port(port: int | None, *, once: bool) -> int:
    if port is not None:
        return port
    return 0 if once else 8000


def _version(value: bool) -> None:
    if value:
        typer.echo(f"jointstiff {JOINTSTIFF_VERSION}")
        raise typer.Exit


@app.callback()
def options(
    *,
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Show the version and end.")
    ] = False,
) -> None:
    """Options of the command itself; Typer calls it before each command."""


def main() -> None:
    """Entry point of the command."""
    app()
