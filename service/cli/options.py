"""Arguments and options that commands share, with their help."""

from __future__ import annotations

import math
import sys
from collections.abc import Sequence
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Final, NamedTuple

import typer

FAR: Final = 5.0
"""Distance of a load point from the flange beyond which its unit is in doubt, in m."""


class Vector(NamedTuple):
    """Three numbers of one option."""

    x: float
    y: float
    z: float


def vector_of(text: str) -> Vector:
    """Return `X,Y,Z` as three numbers.

    Raises:
        typer.BadParameter: it is no such text.
    """
    try:
        return Vector(*(float(part) for part in text.split(",")))
    except (TypeError, ValueError):
        raise typer.BadParameter(f"'{text}' must be three numbers, such as 0,0,120.5") from None


def point_of(text: str) -> Vector:
    """Return `X,Y,Z` in millimetres as a point in metres; ask about one that no tool reaches.

    Raises:
        typer.BadParameter: it is no such text, or further than 5 m from the flange and nobody confirms it.
    """
    point = Vector(*(1e-3 * number for number in vector_of(text)))
    distance = math.hypot(*point)
    if not distance <= FAR:
        question = f"'{text}' in mm is {distance:g} m from the flange"
        asked = math.isfinite(distance) and sys.stdin.isatty()
        if not (asked and typer.confirm(f"{question}. Is that right?", default=False, err=True)):
            raise typer.BadParameter(f"{question}; give X,Y,Z in mm, such as 0,0,120.5")
    return point


LoadPoint = Annotated[
    Vector | None,
    typer.Option(
        "--load-point",
        parser=point_of,
        metavar="X,Y,Z[mm]",
        help="Point where the force acts, in the flange frame, in mm.",
    ),
]

CampaignFile = Annotated[
    Path,
    typer.Argument(
        exists=True,
        dir_okay=False,
        readable=True,
        metavar="FILE",
        help="Campaign file: robot, measurement set and run options in one JSON document.",
    ),
]
FirstFile = Annotated[
    Path,
    typer.Argument(
        exists=True,
        dir_okay=False,
        readable=True,
        metavar="FIRST",
        help="Campaign with the position loop on the motors' encoders, or before a change.",
    ),
]
SecondFile = Annotated[
    Path,
    typer.Argument(
        exists=True,
        dir_okay=False,
        readable=True,
        metavar="SECOND",
        help="Campaign with the position loop on secondary encoders, or after a change.",
    ),
]
RunFile = Annotated[
    Path | None,
    typer.Option(
        exists=True,
        dir_okay=False,
        metavar="FILE",
        help="A run of that campaign, as `identify --json` prints it; identified now if absent.",
    ),
]
NamedRobot = Annotated[
    str | None,
    typer.Option(
        metavar="ROBOT",
        help="File of a robot, or of a campaign that contains one; or a nominal arm of the catalogue by its "
        'name, such as "KUKA KR 210 R2700": `jointstiff robots` lists them.',
    ),
]
Overwrite = Annotated[bool, typer.Option("--overwrite", help="Replace what is there.")]
AsJson = Annotated[bool, typer.Option("--json", help="Print JSON instead of tables.")]
DatabaseUrl = Annotated[
    str,
    typer.Option(
        envvar="JOINTSTIFF_DATABASE",
        metavar="URL",
        help="Database: sqlite:///FILE or postgresql://USER:PASSWORD@HOST/NAME.",
    ),
]
Details = Annotated[bool, typer.Option("--details", help="Print all reasons, warnings, advice and evidence.")]
ServerAddress = Annotated[
    str, typer.Option(envvar="JOINTSTIFF_SERVER", metavar="ADDRESS", help="Address of a running service.")
]
KeysFilePath = Annotated[
    Path | None,
    typer.Option(
        envvar="JOINTSTIFF_KEYS_FILE",
        metavar="FILE",
        help="File of keys, such as a container gets as a secret; it holds hashes only.",
    ),
]
LaboratoryFile = Annotated[
    Path | None,
    typer.Option(
        envvar="JOINTSTIFF_LABORATORY",
        metavar="FILE",
        help="TOML file of the laboratory that issues reports; they name none without it.",
    ),
]
Resample = Annotated[
    int | None,
    typer.Option(min=1, metavar="M", help="Resample: repeat each fit on M random configurations."),
]
Repetitions = Annotated[int | None, typer.Option(min=1, help="Number of draws; default 1000.")]
Seed = Annotated[int | None, typer.Option(min=0, help="Random seed of the draws; default 0.")]
Priors = Annotated[
    list[str] | None,
    typer.Option(
        "--prior",
        metavar="JOINT=STIFFNESS:UNCERTAINTY",
        help="Prior from a data sheet in N.m/rad, such as joint_5=4e5:4e4 (± standard uncertainty). "
        "Repeatable.",
    ),
]
Stiffer = Annotated[
    list[str] | None,
    typer.Option(
        "--stiffer",
        metavar="JOINT,JOINT,...",
        help="Joints, each at least as stiff as the next, such as joint_2,joint_4. Repeatable.",
    ),
]


Links = Annotated[
    str | None,
    typer.Option(
        metavar="JOINT,JOINT,...",
        help="Elastic links, each named by the joint that carries it; default: all.",
    ),
]


def link_names(text: str | None) -> list[str] | None:
    """Return what `--links` says, as the request has it; None if it was not given."""
    return None if text is None else [name.strip() for name in text.split(",")]


def priors(texts: Sequence[str] | None) -> dict[str, dict[str, float]] | None:
    """Return what `--prior` says, as the request has it; None if it was not given.

    Raises:
        typer.BadParameter: naming the text that is none.
    """
    found = {}
    for text in texts or ():
        name, _, numbers = text.rpartition("=")
        stiffness, _, uncertainty = numbers.partition(":")
        try:
            found[name] = {"stiffness": float(stiffness), "standard_uncertainty": float(uncertainty)}
        except ValueError as error:
            raise typer.BadParameter(
                f"'{text}' must be like joint_5=4e5:4e4: joint, stiffness and standard uncertainty",
                param_hint="--prior",
            ) from error
    return found or None


def chains(texts: Sequence[str] | None) -> list[list[str]] | None:
    """Return what `--stiffer` says, as the request has it; None if it was not given."""
    return [[name.strip() for name in text.split(",")] for text in texts or ()] or None


class MethodChoice(StrEnum):
    """Methods of method.md §4."""

    COMPLETE = "complete_pose"
    PARTIAL = "partial_pose"
    DECOUPLED = "decoupled_partial_pose"


class WeightingChoice(StrEnum):
    """Weightings of method.md §3."""

    COVARIANCE = "covariance"
    LENGTH = "characteristic_length"
    UNIFORM = "uniform"


class ElasticityChoice(StrEnum):
    """Models of method.md §7, from simple to rich."""

    JOINTS = "joints"
    COUPLED = "coupled_joints"
    DIAGONAL = "diagonal_links"
    LINKS = "joints_and_links"
    AUTOMATIC = "automatic"


class LossChoice(StrEnum):
    """Losses of method.md §5."""

    SQUARED = "squared"
    HUBER = "huber"
    ABSOLUTE = "absolute"
    AUTOMATIC = "automatic"


class UnitChoice(StrEnum):
    """Units in which tables show stiffnesses, or compliances."""

    MEGA = "MNm/rad"
    DEGREE = "kNm/deg"
    ARC_MINUTE = "Nm/arcmin"
    SI = "Nm/rad"
    COMPLIANCE = "urad/Nm"


Unit = Annotated[
    UnitChoice,
    typer.Option(case_sensitive=False, help="Unit of the tables: 10⁶ N·m/rad, kN·m/°, …, or µrad/(N·m)."),
]


class LoadChoice(StrEnum):
    """Choices for the load of the simulated robot."""

    DEAD_WEIGHT = "dead_weight"
    PULL = "pull"
    OWN_WEIGHT = "own_weight"


class EncoderChoice(StrEnum):
    """Which encoders close the position loop."""

    MOTOR = "motor"
    SECONDARY = "secondary"
