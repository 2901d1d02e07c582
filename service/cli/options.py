"""Arguments and options that commands share, with their help."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import typer


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
    """Return `X,Y,Z` in millimetres as a point in metres; raises as `vector_of` does."""
    return Vector(*(1e-3 * number for number in vector_of(text)))


def file_argument(metavar: str, text: str) -> Any:  # noqa: ANN401 - Typer's
    """Return an argument that is a file to read."""
    return typer.Argument(exists=True, dir_okay=False, readable=True, metavar=metavar, help=text)


def file_option(text: str) -> Any:  # noqa: ANN401 - Typer's
    """Return an option that is a file to read."""
    return typer.Option(exists=True, dir_okay=False, metavar="FILE", help=text)


def output_option(text: str, metavar: str = "FILE") -> Any:  # noqa: ANN401 - Typer's
    """Return the option that names a file to write."""
    return typer.Option("--output", "-o", metavar=metavar, help=text)


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
    file_argument("FILE", "Campaign file: robot, measurement set and run options in one JSON document."),
]
RunFile = Annotated[
    Path | None,
    file_option("Run of that campaign, as `identify --json` prints it; default: identify it now."),
]
NamedRobot = Annotated[
    str | None,
    typer.Option(
        metavar="ROBOT",
        help="File of a robot, or of a campaign that contains one; or a nominal arm of the catalogue by its "
        'name, such as "KUKA KR 210 R2700": `jointstiff robots` lists them.',
    ),
]
DespiteVerdict = Annotated[
    bool, typer.Option("--despite-verdict", help="Continue although the verdict on the run is: do not use.")
]
Overwrite = Annotated[bool, typer.Option("--overwrite", help="Replace existing files.")]
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
        help="File of keys, such as a container's secret; it has only hashes.",
    ),
]
LaboratoryFile = Annotated[
    Path | None,
    typer.Option(
        envvar="JOINTSTIFF_LABORATORY",
        metavar="FILE",
        help="TOML file of the laboratory that issues reports; default: none.",
    ),
]


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
    """Encoders that close the position loop."""

    MOTOR = "motor"
    SECONDARY = "secondary"
