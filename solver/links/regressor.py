"""The linear model of method.md §7: deflections of the targets as a linear function of link compliances.

``δp_X = A_X c + Σ_jk J_j C_θ,jk τ_k + Σ_i B_i C_i w_i``: joints, coupling between joints, links. Frame i is
that of joint i, which moves with it (after its rotation); w_i is the load's wrench in it, force then moment
about its origin o_i, and ``B_i = [R_i, −[p_X − o_i]× R_i]`` moves the target with the frame.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields, replace

import numpy as np

from jointstiff.solver.arrays import FloatArray, IndexArray
from jointstiff.solver.convex.semidefinite.cone import entries, weights
from jointstiff.solver.errors import UnsupportedMethodError
from jointstiff.solver.readings.measurements import Measurements
from jointstiff.solver.regression.compression import Compression
from jointstiff.solver.regression.regressor import RegressorBlock, link_motion, regressor_blocks, whitener
from jointstiff.solver.robot.model import Robot

MOST_JOINTS = 12
"""Maximum number of joints of a robot with elastic links: beyond, unknowns exceed readings."""

_BLOCK = 256
"""Observations per block: their rows stay below 10 MB a target."""


@dataclass(frozen=True)
class ElasticColumns:
    """Columns of each compliance among the P columns of the richest model.

    Entries of matrices are vectors as in `jointstiff.solver.convex.semidefinite.cone`.
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

    def link(self, joint: int) -> IndexArray:
        """(21,) columns of the compliance C_i of the link behind a joint."""
        start = self.n + len(self.coupling) + 21 * self.links.index(joint)
        return np.arange(start, start + 21)


@dataclass(frozen=True, eq=False)
class ElasticBlock:
    """Regressors of B observations of T targets."""

    rows: FloatArray  #: (B, T, 3, P) rows of the deflections; zero where not present
    lever: FloatArray  #: (B, n) distance of the load point from each joint frame's origin [m]
    base: RegressorBlock  #: the joints' regressor and the observations


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
        width = len(parts[0].triangle)
        rows = Compression(width)
        rows.add(np.concatenate([part.triangle for part in parts]))
        sums = {
            field.name: sum(getattr(part, field.name) for part in parts)
            for field in fields(cls)
            if field.name != "triangle"
        }
        return cls(triangle=rows.triangle, **sums)


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
        compression = Compression(self.A.shape[2] + 1)
        augmented = np.concatenate([self.A, self.d[..., None]], axis=-1)
        compression.add(np.sqrt(weight)[:, None, None] * augmented)
        return replace(rows, triangle=compression.triangle)


def elastic_targets(robot: Robot, measurements: Measurements, columns: ElasticColumns) -> ElasticTargets:
    """Return the rows of all targets.

    Raises:
        MeasurementError: a covariance is not one.
    """
    A, d = [], []
    for block in elastic_blocks(robot, measurements, columns):
        part = block.base.measurements
        W = whitener(part.covariance)
        A.append((W @ block.rows)[part.present])
        d.append((W @ part.deflection[..., None])[..., 0][part.present])
    return ElasticTargets(np.concatenate(A), np.concatenate(d))


def elastic_rows(robot: Robot, measurements: Measurements, columns: ElasticColumns) -> ElasticRows:
    """Compress observations, block by block: memory stays flat.

    Raises:
        MeasurementError: a covariance is not one.
    """
    rows = Compression(columns.width + 1)
    lever = np.zeros(robot.n)
    for block in elastic_blocks(robot, measurements, columns):
        part = block.base.measurements
        W = whitener(part.covariance)
        augmented = np.concatenate([block.rows, part.deflection[..., None]], axis=-1)
        rows.add(W @ augmented, count=3 * int(part.present.sum()))
        lever += np.square(block.lever).sum(axis=0)
    return ElasticRows(
        triangle=rows.triangle,
        configurations=len(measurements),
        readings=rows.rows,
        targets=int(measurements.present.sum()),
        force=float(np.square(measurements.force).sum()),
        moment=float(np.square(measurements.moment).sum()),
        lever=lever,
        deflection=float(np.square(measurements.deflection).sum()),
    )


def elastic_blocks(
    robot: Robot, measurements: Measurements, columns: ElasticColumns
) -> Iterator[ElasticBlock]:
    """Yield the regressors of the richest model, block by block."""
    for start in range(0, len(measurements), _BLOCK):
        for base in regressor_blocks(robot, measurements[start : start + _BLOCK]):
            yield _block(robot, base, columns)


def elastic_rows_of(robot: Robot, measurements: Measurements) -> Iterator[tuple[FloatArray, FloatArray]]:
    """Yield rows (B, T, 3, n + 21 n) of joints and all links with the readings' covariance, by blocks."""
    columns = ElasticColumns(robot.n, tuple(range(robot.n)))
    kept = np.r_[columns.joints, *(columns.link(joint) for joint in columns.links)]
    for block in elastic_blocks(robot, measurements, columns):
        yield block.rows[..., kept], block.base.measurements.covariance


def _block(robot: Robot, base: RegressorBlock, columns: ElasticColumns) -> ElasticBlock:
    moves, wrench, lever = link_motion(robot, base)
    rows = np.empty((*base.A.shape[:3], columns.width))
    rows[..., columns.joints] = base.A
    rows[..., columns.coupling] = products(base.jacobian, base.torque[:, None, None])
    for joint in columns.links:
        rows[..., columns.link(joint)] = products(moves[joint], wrench[joint, :, None, None])
    rows[~base.measurements.present] = 0.0
    return ElasticBlock(rows, np.linalg.norm(lever, axis=-1), base)


def products(moves: FloatArray, load: FloatArray) -> FloatArray:
    """Columns of ``moves C load`` for the entries of a symmetric C: (..., k (k + 1) / 2) of (..., k) each."""
    size = moves.shape[-1]
    i, j = entries(size)
    # An entry off the diagonal stands for two of the matrix, each 1/√2 of it.
    both: FloatArray = moves[..., i] * load[..., j] + moves[..., j] * load[..., i]
    return both * np.where(i == j, 0.5, 1.0 / weights(size))
