"""Arguments and options that commands share, with their help."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

__all__ = [
    "AsJson",
    "CampaignFile",
    "DatabaseUrl",
    "EncoderChoice",
    "LoadChoice",
    "MethodChoice",
    "WeightingChoice",
]

CampaignFile = Annotated[
    Path,
    typer.Argument(
        exists=True,
        dir_okay=False,
        readable=True,
        metavar="FILE",
        help="Campaign: robot, measurement set and run in one JSON document.",
    ),
]
AsJson = Annotated[bool, typer.Option("--json", help="Print JSON instead of tables.")]
DatabaseUrl = Annotated[
    str,
    typer.Option(
        envvar="JOINTSTIFF_DATABASE",
        metavar="URL",
        help="sqlite:///FILE, or postgresql://USER:PASSWORD@HOST/NAME.",
    ),
]


class MethodChoice(StrEnum):
    """Methods of METHOD.md §4."""

    COMPLETE = "complete_pose"
    PARTIAL = "partial_pose"
    DECOUPLED = "decoupled_partial_pose"


class WeightingChoice(StrEnum):
    """Weightings of METHOD.md §3."""

    COVARIANCE = "covariance"
    LENGTH = "characteristic_length"
    UNIFORM = "uniform"


class LoadChoice(StrEnum):
    """How the simulated robot is loaded."""

    DEAD_WEIGHT = "dead_weight"
    PULL = "pull"


class EncoderChoice(StrEnum):
    """Which encoders close the position loop."""

    MOTOR = "motor"
    SECONDARY = "secondary"
