"""The command `jointstiff simulate`: an example campaign whose truth is known."""

from pathlib import Path
from typing import Annotated

import typer

from jointstiff.service.cli.answers import refuse_existing, write_text
from jointstiff.service.cli.options import EncoderChoice, LoadChoice


def simulate(
    file: Annotated[
        Path, typer.Argument(dir_okay=False, metavar="FILE", help="File to write the campaign to.")
    ],
    *,
    load: Annotated[
        LoadChoice,
        typer.Option(
            help="Load: a weight on the flange, pulls in all directions, or only the arm's own weight."
        ),
    ] = LoadChoice.PULL,
    configurations: Annotated[int, typer.Option(min=1, max=5_000, help="Number of postures.")] = 19,
    force: Annotated[
        float, typer.Option(min=0.0, max=1e5, help="Magnitude of the force, in newtons.")
    ] = 1500.0,
    sigma: Annotated[
        float, typer.Option(min=0.0, max=1e-2, help="Standard deviation of a coordinate, in metres.")
    ] = 2e-5,
    encoders: Annotated[
        EncoderChoice, typer.Option(help="Encoders that close the position loop.")
    ] = EncoderChoice.MOTOR,
    seed: Annotated[int, typer.Option(min=0, help="Random seed; the same seed gives the same file.")] = 1,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace an existing file.")] = False,
) -> None:
    """Write a simulated example campaign."""
    import json

    from jointstiff.service.tables.terminal import console
    from jointstiff.simulator import default_arm, simulate_campaign
    from jointstiff.simulator.own_weight import unloaded_campaign

    refuse_existing(file, overwrite=overwrite)
    arm = default_arm(encoders.value)
    if load is LoadChoice.OWN_WEIGHT:
        document = unloaded_campaign(arm, configurations=configurations, sigma=sigma, seed=seed)
    else:
        document = simulate_campaign(
            arm,
            configurations=configurations,
            load="pull" if load is LoadChoice.PULL else "dead_weight",
            force=force,
            sigma=sigma,
            encoders=encoders.value,
            seed=seed,
        )
    write_text(file, json.dumps(document, indent=1))
    acts = "own weight" if load is LoadChoice.OWN_WEIGHT else f"{force:g} N"
    stiffness = ", ".join(f"{1e-6 * k:.3g}" for k in arm.stiffnesses)
    console().print(
        f"wrote {file}: {configurations} configurations, {acts}\n"
        f"true stiffnesses, joint 1 to {len(arm.stiffnesses)}: {stiffness} × 10⁶ N·m/rad\n"
        f"now: jointstiff identify {file}",
        markup=False,
        soft_wrap=True,
    )
