# ruff: noqa: E501
"""Arms of published dimensions as calibration finds them: every number a little off."""

from collections.abc import Sequence

import numpy as np

from jointstiff.schemas.robot import DhRow
from jointstiff.solver.mechanics.chain import chain_dh_rows
from jointstiff.solver.mechanics.robot import Robot

HALF = np.pi / 2
ARMS = {
    "ur5": (  # the standard DH table that Universal Robots publishes
        "standard",
        [(0, HALF, 0.089159, 0), (-0.425, 0, 0, 0), (-0.39225, 0, 0, 0), (0, HALF, 0.10915, 0), (0, -HALF, 0.09465, 0), (0, 0, 0.0823, 0)],
    ),
    "r2000ic": (
        "modified",
        [(0, 0, 0.67, 0), (0.312, -HALF, 0, -HALF), (1.075, 0, 0, 0), (0.225, -HALF, 1.28, 0), (0, HALF, 0, 0), (0, -HALF, 0.215, 0)],
    ),
}  # fmt: skip


def arm(name: str, crookedness: float = 0.0) -> Robot:
    """An arm whose numbers are off by so much [m, rad], as calibration finds them."""
    convention, rows = ARMS[name]
    draw = np.random.default_rng(3)
    crooked = [[value + crookedness * draw.standard_normal() for value in row] for row in rows]
    return Robot(chain_dh_rows(chain_rows(crooked), convention, name).model())


def chain_rows(rows: Sequence[Sequence[float]]) -> list[DhRow]:
    """Rows of a table by their numbers a [m], alpha [rad], d [m] and theta [rad]."""
    return [DhRow(a=float(a), alpha=alpha, d=float(d), theta=theta) for a, alpha, d, theta in rows]
