"""The command line: `jointstiff`."""

from __future__ import annotations

import json
import os
import secrets
import socket
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, TypeVar

import typer
from pydantic import ValidationError

from examples.simulator import default_arm, simulate_campaign
from schemas.comparison import Comparison, ComparisonOptions
from schemas.pair import PairOptions
from schemas.run_options import RunOptions
from service import campaigns
from service.campaigns import CampaignError, read_campaign
from service.cli_geometry import geometry_command
from service.cli_import import import_command
from service.cli_options import (
    AsJson,
    CampaignFile,
    DatabaseUrl,
    ElasticityChoice,
    EncoderChoice,
    FirstFile,
    Links,
    LoadChoice,
    LossChoice,
    MethodChoice,
    Priors,
    Repetitions,
    Resample,
    SecondFile,
    Seed,
    Stiffer,
    WeightingChoice,
    chains,
    link_names,
    priors,
)
from service.client import RefusedError, ServiceClient
from service.comparison_csv import comparison_csv
from service.comparison_table import comparison_table
from service.demo import run_demo
from service.pair_table import pair_report
from service.problems import invalid_request
from service.server import ServerError, run_server
from service.store_errors import StoreError
from service.terminal import console, problem_text, progress_bar, run_report
from service.versions import JOINTSTIFF_VERSION
from service.worker import run_worker

__all__ = ["main"]

Options = TypeVar("Options", RunOptions, ComparisonOptions)

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

app.command("import")(import_command)
app.command("geometry")(geometry_command)

_INCLUDED = {True: "included", False: "neglected", None: None}


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
    loss: Annotated[LossChoice | None, typer.Option(help="huber bounds what a bumped target can do.")] = None,
    huber_threshold: Annotated[
        float | None,
        typer.Option(min=0.1, max=100.0, metavar="SIGMAS", help="For loss huber; 2.8 if absent."),
    ] = None,
    complementary_stiffness: Annotated[
        bool | None,
        typer.Option(
            "--complementary-stiffness/--neglect-complementary-stiffness",
            help="Let the load follow the deflection, or not.",
        ),
    ] = None,
    prior: Priors = None,
    stiffer: Stiffer = None,
    elasticity: Annotated[
        ElasticityChoice | None, typer.Option(help="What bends; the penalty is chosen by cross-validation.")
    ] = None,
    links: Links = None,
    link_penalty: Annotated[
        float | None, typer.Option(min=1e-9, max=1e3, help="Weight of the penalty, instead of choosing it.")
    ] = None,
    confidence: Annotated[
        float | None, typer.Option(min=0.5, max=0.9999, help="Level of the intervals.")
    ] = None,
    resample: Resample = None,
    repetitions: Repetitions = 1000,
    seed: Seed = 0,
    as_json: AsJson = False,
) -> None:
    """Identify the joint stiffnesses of a campaign, without a server."""
    chosen = {
        "method": method,
        "weighting": weighting,
        "characteristic_length": characteristic_length,
        "positive": positive,
        "loss": loss,
        "huber_threshold": huber_threshold,
        "complementary_stiffness": _INCLUDED[complementary_stiffness],
        "priors": priors(prior),
        "stiffness_order": chains(stiffer),
        "elasticity": elasticity,
        "links": link_names(links),
        "link_penalty": link_penalty,
        "confidence": confidence,
        "resampling": _resampling(resample, repetitions, seed),
    }
    changes = {name: value for name, value in chosen.items() if value is not None}
    try:
        campaign = read_campaign(file)
        options = _changed(campaign.run, changes)
        with progress_bar(shown=_takes_long(options)) as tell:
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
def compare(
    file: CampaignFile,
    *,
    resample: Resample = None,
    repetitions: Repetitions = 1000,
    seed: Seed = 0,
    positive: Annotated[
        bool | None,
        typer.Option("--positive/--unconstrained", help="Compliances zero or positive, or free, not both."),
    ] = None,
    as_json: AsJson = False,
    as_csv: Annotated[bool, typer.Option("--csv", help="Print a table for spreadsheets.")] = False,
) -> None:
    """Compare the methods on a campaign, unconstrained and constrained, as the paper's Table II does."""
    constraint = None if positive is None else ["positive" if positive else "unconstrained"]
    chosen = {"constraints": constraint, "resampling": _resampling(resample, repetitions, seed)}
    try:
        campaign = read_campaign(file)
        given = {name: value for name, value in chosen.items() if value is not None}
        options = _changed(ComparisonOptions(confidence=campaign.run.confidence), given)
        with progress_bar(shown=resample is not None) as tell:
            comparison = campaigns.compare(campaign, options, tell)
    except CampaignError as error:
        raise _refused(error) from error
    _print_comparison(comparison, as_json=as_json, as_csv=as_csv)
    if comparison.state != "succeeded":
        raise typer.Exit(1)


def _print_comparison(comparison: Comparison, *, as_json: bool, as_csv: bool) -> None:
    if as_json:
        typer.echo(comparison.model_dump_json(indent=2))
    elif as_csv and comparison.result is not None:
        typer.echo(comparison_csv(comparison.result), nl=False)
    else:
        out = console()
        out.print(comparison_table(comparison, out.width))


@app.command()
def pair(
    first: FirstFile,
    second: SecondFile,
    *,
    method: Annotated[MethodChoice | None, typer.Option(help="Instead of the first file's.")] = None,
    ordered: Annotated[
        bool, typer.Option("--ordered", help="Also both in one problem: no joint is softer in the second.")
    ] = False,
    confidence: Annotated[
        float | None, typer.Option(min=0.5, max=0.9999, help="Level of the intervals.")
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Compare two campaigns: encoders of motors and secondary ones, before and after, unit A and B.

    Both are identified as the run in the first file says.
    """
    try:
        campaign, other = read_campaign(first), read_campaign(second)
        options = _changed(campaign.run, {"method": method} if method is not None else {})
        chosen = PairOptions.model_validate(
            {"options": options.model_dump(), "ordered": ordered, "confidence": confidence}
        )
        found = campaigns.pair(campaign, other, chosen)
    except ValidationError as error:
        raise _refused(CampaignError(invalid_request(error.errors()))) from error
    except CampaignError as error:
        raise _refused(error) from error
    if as_json:
        typer.echo(found.model_dump_json(indent=2))
    else:
        console().print(pair_report(found))
    if found.state != "succeeded":
        raise typer.Exit(1)


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
        with ServiceClient(server, _warn) as client:
            client.ping()
            robot, stored = client.post_campaign(campaign)
            with progress_bar(shown=_takes_long(understood.run)) as tell:
                run = client.run(stored["id"], campaign.get("run", {}), tell)
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


def _changed(options: Options, changes: Mapping[str, object]) -> Options:
    try:
        return type(options).model_validate({**options.model_dump(), **changes})
    except ValidationError as error:
        raise CampaignError(invalid_request(error.errors())) from None


def _takes_long(options: RunOptions) -> bool:
    return options.resampling is not None or (options.elasticity != "joints" and options.link_penalty is None)


def _resampling(size: int | None, repetitions: int, seed: int) -> dict[str, int] | None:
    return None if size is None else {"size": size, "repetitions": repetitions, "seed": seed}


def _warn(message: str) -> None:
    console(stderr=True).print(message, style="yellow", markup=False, soft_wrap=True)


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
