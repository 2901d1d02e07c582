"""Rows of elastic models: joints, coupled joints and links beside each other, compressed (method.md §7)."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields, replace

import numpy as np

from jointstiff.solver.arrays import FloatArray, IndexArray
from jointstiff.solver.errors import UnsupportedMethodError
from jointstiff.solver.readings.measurements import Measurements
from jointstiff.solver.robot.model import Robot
from jointstiff.solver.terms.block import RegressorBlock, regressor_blocks
from jointstiff.solver.terms.joints import JOINTS
from jointstiff.solver.terms.links import COUPLED_JOINTS, link_motion, links_behind
from jointstiff.solver.terms.term import Term, rows_of
from jointstiff.solver.triangle import Triangle, triangle_of, whitened

MOST_JOINTS = 12
"""Maximum number of joints of a robot with elastic links: beyond, unknowns exceed readings."""

_BLOCK = 256
"""Observations per block: their rows stay below 10 MB a target."""


@dataclass(frozen=True)
class ElasticColumns:
    """Columns of each compliance among the P columns of the richest model.

    Entries of matrices are vectors as in `jointstiff.solver.convex.conic`.
    """

    n: int  #: joints
    links: tuple[int, ...]  #: which joints' frames carry a link that bends

    def __post_init__(self) -> None:
        if self.n > MOST_JOINTS:
            raise UnsupportedMethodError(
                f"the robot has {self.n} joints; elastic links support at most {MOST_JOINTS}",
                where="elasticity",
                remedy="use elasticity joints",
            )

    @property
    def width(self) -> int:
        """P."""
        return self.n + len(self.coupling) + 21 * len(self.links)

    @property
    def joints(self) -> IndexArray:
        """(n,) columns of the joint compliances c [m/(rad/(N·m))]."""
        return np.arange(self.n)

    @property
    def coupling(self) -> IndexArray:
        """(n (n + 1) / 2,) columns of the full joint compliance C_θ [m/(rad/(N·m))]."""
        return np.arange(self.n, self.n + self.n * (self.n + 1) // 2)

    @property
    def terms(self) -> tuple[Term, ...]:
        """Return the terms of all columns, in their order."""
        return JOINTS, COUPLED_JOINTS, links_behind(self.links)

    def link(self, joint: int) -> IndexArray:
        """(21,) columns of the compliance C_i of the link behind a joint."""
        start = self.n + len(self.coupling) + 21 * self.links.index(joint)
        return np.arange(start, start + 21)


@dataclass(frozen=True, eq=False)
class ElasticRows:
    """Contribution of observations to a fit: compressed rows, and sums that give the penalty its scale."""

    #: (P + 1, P + 1) with ``TᵀT`` the Gram matrix of the rows [A d], whitened in units of sigma
    triangle: FloatArray
    configurations: int  #: how many
    readings: int  #: coordinates that were read
    targets: int  #: targets that were read
    force: float  #: sum of ‖F‖² [N²]
    moment: float  #: sum of ‖M‖² [N²·m²]
    lever: FloatArray  #: (n,) sum of the squared distances of the load point from the frames' origins [m²]
    deflection: float  #: sum of ‖δp‖² [m²]

    @classmethod
    def merged(cls, parts: list[ElasticRows]) -> ElasticRows:
        """Return the rows of all observations of the parts; nothing is subtracted, so nothing cancels."""
        triangle = triangle_of(np.concatenate([part.triangle for part in parts]))
        sums = {
            field.name: sum(getattr(part, field.name) for part in parts)
            for field in fields(cls)
            if field.name != "triangle"
        }
        return cls(triangle=triangle, **sums)


@dataclass(frozen=True, eq=False)
class ElasticTargets:
    """Rows of targets one by one, which a robust loss needs: nothing of them is compressed."""

    A: FloatArray  #: (K, 3, P) of K targets that were read, whitened in units of sigma
    d: FloatArray  #: (K, 3) whitened deflections [m]

    @classmethod
    def merged(cls, parts: Sequence[ElasticTargets]) -> ElasticTargets:
        """Return the targets of all parts."""
        return cls(np.concatenate([part.A for part in parts]), np.concatenate([part.d for part in parts]))

    def residuals(self, compliances: FloatArray) -> FloatArray:
        """(K, 3) whitened residuals of compliances (P,) [m]."""
        residuals: FloatArray = self.A @ compliances - self.d
        return residuals

    def weighted(self, rows: ElasticRows, weight: FloatArray) -> ElasticRows:
        """Return the compressed rows, each target weighted (K,)."""
        augmented = np.concatenate([self.A, self.d[..., None]], axis=-1)
        weighted = np.sqrt(weight)[:, None, None] * augmented
        return replace(rows, triangle=triangle_of(weighted.reshape(-1, augmented.shape[-1])))


def elastic_targets(robot: Robot, measurements: Measurements, columns: ElasticColumns) -> ElasticTargets:
    """Return the rows of all targets.

    Raises:
        MeasurementError: a covariance is not one.
    """
    parts = []
    for block, rows in elastic_blocks(robot, measurements, columns):
        part = block.measurements
        parts.append(whitened(part.covariance, rows)[part.present])
    rows = np.concatenate(parts)
    return ElasticTargets(rows[..., :-1], rows[..., -1])


def elastic_rows(robot: Robot, measurements: Measurements, columns: ElasticColumns) -> ElasticRows:
    """Compress observations, block by block: memory stays flat.

    Raises:
        MeasurementError: a covariance is not one.
    """
    triangle, lever = Triangle(entries=columns.width), np.zeros(robot.n)
    for block, rows in elastic_blocks(robot, measurements, columns):
        part = block.measurements
        triangle.add(whitened(part.covariance, rows), count=3 * int(part.present.sum()))
        lever += np.square(link_motion(block)[2]).sum(axis=(0, 2))
    return ElasticRows(
        triangle=triangle.R,
        configurations=len(measurements),
        readings=triangle.rows,
        targets=int(measurements.present.sum()),
        force=float(np.square(measurements.force).sum()),
        moment=float(np.square(measurements.moment).sum()),
        lever=lever,
        deflection=float(np.square(measurements.deflection).sum()),
    )


def elastic_blocks(
    robot: Robot, measurements: Measurements, columns: ElasticColumns
) -> Iterator[tuple[RegressorBlock, FloatArray]]:
    """Yield blocks with their rows (B, T, 3, P + 1): columns of the richest model, then the readings."""
    for start in range(0, len(measurements), _BLOCK):
        for block in regressor_blocks(robot, measurements[start : start + _BLOCK]):
            yield block, rows_of(block, columns.terms, np.zeros(robot.n)).targets
