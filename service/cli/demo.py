"""Commands with simulated readings of known stiffnesses: `examples`, `simulate`, `rehearse` and `demo`."""

from __future__ import annotations

import os
import signal
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final, Literal

import typer

from jointstiff.service.cli.options import (
    AsJson,
    Overwrite,
    check_ending,
    file_argument,
    path_option,
    refuse_existing,
    write_json,
)
from jointstiff.service.settings import Settings

if TYPE_CHECKING:
    from jointstiff.schemas.run import Run

_LARGEST_NOISE: Final = 1e-2
"""Largest noise of a coordinate [m]: a greater number was meant in mm or µm."""


def examples(
    folder: Annotated[
        Path, typer.Argument(file_okay=False, metavar="[DIR]", help="Folder to write the files to.")
    ] = Path("examples"),
    *,
    overwrite: Overwrite = False,
) -> None:
    """Write the example files of the guides: tables, points, sweeps, robots, campaigns, a program."""
    from jointstiff.simulator.files import example_files

    folder.mkdir(parents=True, exist_ok=True)
    for name, text in example_files():
        path = folder / name
        keeps_old = path.exists() and not overwrite
        if not keeps_old:
            path.write_text(text, encoding="utf-8")
        typer.echo(f"{'kept' if keeps_old else 'wrote'} {path}")


def simulate(
    file: Annotated[
        Path, typer.Argument(dir_okay=False, metavar="FILE", help="File to write the campaign to.")
    ],
    *,
    load: Annotated[
        Literal["dead_weight", "pull", "own_weight"],
        typer.Option(
            help="Kind of load: a weight on the flange, forces in all directions, or only the own weight of "
            "the arm."
        ),
    ] = "pull",
    configurations: Annotated[int, typer.Option(min=1, max=5_000, help="Number of postures.")] = 19,
    force: Annotated[
        float, typer.Option(min=0.0, max=1e5, help="Magnitude of the force, in newtons.")
    ] = 1500.0,
    sigma: Annotated[
        float,
        typer.Option(min=0.0, help="Standard deviation of the noise of each coordinate, in metres."),
    ] = 2e-5,
    encoders: Annotated[
        Literal["motor", "secondary"],
        typer.Option(
            help="Encoders with which the controller closes the position loop: `motor` at the motors, "
            "`secondary` behind the gearboxes."
        ),
    ] = "motor",
    seed: Annotated[int, typer.Option(min=0, help="Random seed; the same seed gives the same file.")] = 1,
    overwrite: Overwrite = False,
) -> None:
    """Write a simulated example campaign."""
    from jointstiff.simulator import default_arm, simulate_campaign
    from jointstiff.simulator.own_weight import unloaded_campaign

    refuse_existing(file, overwrite=overwrite)
    if sigma > _LARGEST_NOISE:
        hint = f"{sigma:g} m is no noise of readings; give metres, such as 2e-5 for 20 µm; at most 0.01"
        raise typer.BadParameter(hint, param_hint="--sigma")
    arm = default_arm(encoders)
    if load == "own_weight":
        load_text = "own weight"
        document = unloaded_campaign(arm, configurations=configurations, sigma=sigma, seed=seed)
    else:
        load_text = f"{force:g} N"
        document = simulate_campaign(
            arm,
            configurations=configurations,
            load=load,
            force=force,
            sigma=sigma,
            encoders=encoders,
            seed=seed,
        )
    write_json(file, document)
    stiffness = ", ".join(f"{1e-6 * k:.3g}" for k in arm.stiffnesses)
    typer.echo(
        f"wrote {file}: {configurations} configurations, {load_text}\n"
        f"true stiffnesses, joint 1 to {len(arm.stiffnesses)}: {stiffness} × 10⁶ N·m/rad\n"
        f"now: jointstiff identify {file}"
    )


def rehearse(
    file: Annotated[
        Path,
        file_argument(
            "FILE", "File of a campaign, measured or with empty readings; or file of a saved run or plan."
        ),
    ],
    *,
    robot: Annotated[
        str | None,
        typer.Option(
            help="Robot of the plan, if FILE is a plan: a file, or the name of an arm of the catalogue."
        ),
    ] = None,
    stiffness: Annotated[
        list[str] | None,
        typer.Option(
            metavar="JOINT=STIFFNESS",
            help="Stiffness of a joint with which readings are simulated, in N·m/rad. Repeatable.",
        ),
    ] = None,
    seed: Annotated[int, typer.Option(min=0, help="Random seed of the noise.")] = 1,
    save: Annotated[Path | None, path_option("File to write the whole result to.", "RESULT.json")] = None,
    overwrite: Overwrite = False,
    as_json: AsJson = False,
) -> None:
    """Rehearse a campaign: simulate its readings with known stiffnesses, and identify these."""
    from jointstiff.service.library.rehearse import rehearse as do_rehearse
    from jointstiff.service.tables.terminal import console, lay_out_parts

    planted = _parse_stiffnesses(stiffness or ())
    if save is not None:
        check_ending(save, [".json"])
        refuse_existing(save, overwrite=overwrite, inputs=(file, robot))
    result = do_rehearse(file, robot=robot, stiffness=planted, seed=seed)
    if save is not None:
        result.save(save)
    if as_json:
        typer.echo(result.model_dump_json(indent=2))
    else:
        console().print(lay_out_parts(result._parts()))


def _parse_stiffnesses(texts: Sequence[str]) -> dict[str, float]:
    """Return joint → stiffness [N·m/rad] of texts such as `joint_2=3e6`.

    Raises:
        typer.BadParameter: a text has another form.
    """
    stiffnesses = dict[str, float]()
    for text in texts:
        name, _, number = text.partition("=")
        try:
            stiffnesses[name] = float(number)
        except ValueError:
            raise typer.BadParameter(f"'{text}' must be like joint_2=3e6", param_hint="--stiffness") from None
    return stiffnesses


def demo(
    *,
    once: Annotated[bool, typer.Option("--once", help="Stop after printing the tables.")] = False,
    port: Annotated[
        int | None,
        typer.Option(
            min=0, max=65535, help="Port of the service; default: 8000, or any free port if --once is given."
        ),
    ] = None,
    database: Annotated[
        str,
        typer.Option(
            metavar="URL",
            help="Database of the demonstration; the database that `serve` uses is not changed.",
        ),
    ] = "sqlite:///jointstiff-demo.db",
) -> None:
    """Start the service with an example campaign."""
    from jointstiff.service.server import run_server

    port = 8000 if port is None and not once else port
    # The service runs in this process, so that no signal can end the command and leave the service running.
    # The demonstration is a client in another thread of this process, and knows only the service's address.
    status = [0]  # exit status, in a list so that `show` can change it

    def show(address: str) -> None:
        """Show the example on the service at an address; end the service if `once`, or after a failure."""
        status[0] = 1  # for the case that the next line raises an error
        try:
            status[0] = _show_example(address, once=once)
        finally:
            if once or status[0]:
                os.kill(os.getpid(), signal.SIGTERM)
        if not once and not status[0]:
            typer.echo("Ctrl-C ends the service.")

    try:
        run_server(Settings(port=port or 0, database=database), show)
    except KeyboardInterrupt:  # Ctrl-C is the usual end of the demonstration
        pass
    except SystemExit as ended:  # raised by the handler of SIGTERM, or by a server that could not start
        if ended.code:
            raise
    raise typer.Exit(status[0])


def _show_example(address: str, *, once: bool) -> int:
    """Post the example campaign and a comparison, and print the run; return the exit status.

    Unless `once`, print the address of the run's page, too.
    """
    from jointstiff.service.kinds.run.kind import RUN
    from jointstiff.service.problems import RefusedError
    from jointstiff.service.reports.job import job_parts
    from jointstiff.service.tables.terminal import console, lay_out_parts, problem_text

    try:
        run = _post_example(address)
    except RefusedError as refused:
        console(stderr=True).print(problem_text(refused.problem))
        return 1
    console().print(lay_out_parts(job_parts(RUN, run)))
    if once:  # the service ends now, so that the address of a page would be of no use
        typer.echo(f"\nRun {run.id}\nTo open the page of the run, use the same command without --once")
    else:
        typer.echo(f"\nOpen the page: {address}/#/runs/{run.id}")
    return 0


def _post_example(address: str) -> Run:
    """Post the example campaign and a comparison for the page, print their ids, and return the run.

    The idempotency keys are made from the content of the requests, so that a second demonstration shows the
    run and the comparison stored by the first.

    Raises:
        RefusedError: the service refuses a request.
    """
    from jointstiff.schemas.fields import content_key
    from jointstiff.service.library.client import Client
    from jointstiff.service.resources.documents import to_json_text
    from jointstiff.simulator import default_arm, simulate_campaign

    class ClientPostingOnce(Client):
        """Client whose requests have an idempotency key made from their content."""

        def carry_out_request(self, kind: Any, request: Any, files: Any, follow: Any) -> Any:  # noqa: ANN401 - a job
            """Post a request, or find the job of an equal request; return the job when it has ended."""
            text, jobs = to_json_text(request), getattr(self, kind.collection)
            return jobs.wait(jobs.create(text, key=content_key(text), files=files), follow)

    with ClientPostingOnce(address) as client:
        client.ping()
        campaign = simulate_campaign(default_arm(), load="dead_weight", force=400.0, seed=1)
        run: Run = client.runs.wait(client.post(campaign, once=True))
        stored = client.measurement_sets.get(run.request.measurement_set_id)
        counts = f"{len(stored.observations)} observations, {len(stored.warnings)} warnings"
        typer.echo(f"robot {stored.robot_id}\nmeasurement set {stored.id} ({counts})\n")
        client.compare(run)
    return run
