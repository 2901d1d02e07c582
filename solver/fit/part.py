"""Parts of a campaign, such as folds: their rows for elastic models, compressed once (method.md §7)."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import Final, NamedTuple

import numpy as np

from jointstiff.solver.arrays import FloatArray, IndexArray
from jointstiff.solver.fit.rows import Rows
from jointstiff.solver.fit.statements import Statements
from jointstiff.solver.fit.triangle import Triangle, compute_triangular_factor
from jointstiff.solver.mechanics.block import BlockRows
from jointstiff.solver.models import Columns

MOST_TARGETS: Final = 500
"""Greatest number of targets for which robust losses are supported: one fit then takes about 0.5 s."""
_BLOCK: Final = 256
"""Number of observations in a block: the rows of a block stay below 10 MB for each target."""


@dataclass(frozen=True, eq=False)
class Sums:
    """Counts and sums over the observations of a part, which determine the scale of the penalty."""

    observations: int  #: number of observations
    readings: int  #: number of coordinates and encoders that were read
    targets: int  #: number of targets that were read
    squared_force: float  #: sum over the observations of ‖F‖² [N²]
    squared_moment: float  #: sum over the observations of ‖M‖² [N²·m²]
    #: (n + 1,) sum of the squared distances of the load point from the origins of the joint frames and, as
    #: the last number, of the base [m²]
    squared_levers: FloatArray
    squared_deflection: float  #: sum over the targets of ‖δp‖² [m²]

    @classmethod
    def add(cls, parts: Sequence[Sums]) -> Sums:
        """Return the counts and sums over the observations of several parts together."""
        sums = {}
        for field in fields(cls):
            sums[field.name] = sum(getattr(of_part, field.name) for of_part in parts)
        return cls(**sums)


class RowColumns(NamedTuple):
    """Columns of rows [A B d] of the least-squares problem ``A x + B v ≈ d``, as views of the rows.

    The unknowns are the P compliances x and K systematic errors v with a prior.
    """

    A: FloatArray  #: (..., P) columns of the compliances x
    B: FloatArray  #: (..., K) columns of the errors v, in units of their standard uncertainties
    d: FloatArray  #: (...,) readings

    @classmethod
    def split(cls, rows: FloatArray, compliances: int) -> RowColumns:
        """Split rows (..., P + K + 1); `compliances` is the number P of compliances."""
        return cls(rows[..., :compliances], rows[..., compliances:-1], rows[..., -1])


class Regression(NamedTuple):
    """Least-squares problem ``S x ≈ s`` in the P compliances x."""

    S: FloatArray  #: (P + 1, P) regressor
    s: FloatArray  #: (P + 1,) readings

    @classmethod
    def split(cls, rows: FloatArray) -> Regression:
        """Split rows [S s] (P + 1, P + 1)."""
        return cls(rows[:, :-1], rows[:, -1])


class _EliminatedErrors(NamedTuple):
    """Least-squares problem in the P compliances x alone, and the K errors ``v = v_0 − V x`` that fit x."""

    regression: Regression  # problem in x alone, with the same optimum as the problem in x and v
    V: FloatArray  # (K, P) by how much the best errors fall for a unit of each compliance
    v_0: FloatArray  # (K,) the best errors if all compliances are zero


@dataclass(frozen=True, eq=False)
class Part:
    """Part of a measurement set, such as a fold: its rows for all elastic models, compressed.

    The rows are [A B d]: columns A of P compliances, then columns B of K stated errors in units of their
    standard uncertainties, then the readings d. `RowColumns` splits such rows.
    """

    #: (P + K + 1, P + K + 1) with ``TᵀT`` the Gram matrix of the rows [A B d], whitened in units of sigma
    triangle: FloatArray
    sums: Sums  #: counts and sums over the observations
    #: (T, 3, P + K + 1) whitened rows [A B d] of each target, which a robust loss needs; T = 0 for more than
    #: `MOST_TARGETS` targets
    targets: FloatArray
    statements: Statements  #: statements with K unknowns, and the prior of the compliances
    compliances: int  #: number P of columns of compliances

    @classmethod
    def merge(cls, parts: Sequence[Part]) -> Part:
        """Merge several parts of a measurement set into one part.

        The QR factor of the stacked QR factors of the parts is that of all their rows. The rows of single
        targets are dropped if they become too many.
        """
        sums = Sums.add([part.sums for part in parts])
        factors = np.concatenate([part.triangle for part in parts])
        targets = np.concatenate([part.targets for part in parts])
        if sums.targets > MOST_TARGETS:
            targets = targets[:0]
        return replace(parts[0], triangle=compute_triangular_factor(factors), sums=sums, targets=targets)

    def with_sigma(self, sigma: float) -> Part:
        """Return the part with statements weighted by another standard uncertainty of a reading [m]."""
        return replace(self, statements=replace(self.statements, sigma=sigma))

    @property
    def stated_errors(self) -> int:
        """Number K of stated errors."""
        return int(self.triangle.shape[1]) - 1 - self.compliances

    @cached_property
    def stated(self) -> FloatArray:
        """Rows (q, P + K + 1) of the priors: first of the K errors, then of the compliances."""
        return self.statements.build_rows(self.compliances, self.stated_errors)

    @property
    def target_columns(self) -> RowColumns:
        """Columns of the rows of single targets: A (T, 3, P), B (T, 3, K) and the deflections d (T, 3)."""
        return RowColumns.split(self.targets, self.compliances)

    @cached_property
    def _eliminated(self) -> _EliminatedErrors:
        """The least-squares problem ``A x + B v ≈ d`` of readings and priors, with the K errors v eliminated.

        The QR factor of the rows [B A d] of readings and priors is

            [R_B  R_A  r]    K rows
            [ 0    S   s]    P + 1 rows

        The errors appear only in the upper rows, which ``v = R_B⁻¹ (r − R_A x)`` satisfies exactly for any
        x. So the lower rows ``S x ≈ s`` are the problem in x alone.
        """
        K = self.stated_errors
        readings_and_priors = np.vstack([self.triangle, self.stated])
        A, B, d = RowColumns.split(readings_and_priors, self.compliances)
        factor = compute_triangular_factor(np.hstack([B, A, d[:, None]]))
        R_B, R_A_r, S_s = factor[:K, :K], factor[:K, K:], factor[K:, K:]
        V_v_0 = np.asarray(np.linalg.solve(R_B, R_A_r), dtype=np.float64)
        return _EliminatedErrors(Regression.split(S_s), V=V_v_0[:, :-1], v_0=V_v_0[:, -1])

    @property
    def regression(self) -> Regression:
        """Least-squares problem ``S x ≈ s`` of readings and priors in the compliances x alone.

        Its solution equals the compliances of a fit together with the K systematic errors, which have priors.
        """
        return self._eliminated.regression if len(self.stated) else Regression.split(self.triangle)

    @property
    def count(self) -> int:
        """Number of readings and of stated compliances."""
        return self.sums.readings + len(self.stated) - self.stated_errors

    def append_fitted_errors(self, compliances: FloatArray) -> FloatArray:
        """Append to compliances x (..., P) the systematic errors v (..., K) that fit best in least squares.

        The best errors for given compliances are ``v = v_0 − V x``. Without errors, nothing is appended.
        """
        if not self.stated_errors:
            return compliances
        V, v_0 = self._eliminated.V, self._eliminated.v_0
        errors = v_0 - compliances @ V.T  # for each row of compliances
        return np.concatenate([compliances, errors], axis=-1)

    def compute_residual_norms(self, unknowns: FloatArray) -> FloatArray:
        """Return the norm ‖A x + B v − d‖ (T,) [m] of the whitened residual of each target.

        Args:
            unknowns: (P + K,) compliances x, then systematic errors v.
        """
        regressor, deflections = self.targets[..., :-1], self.targets[..., -1]  # [A B] and d
        residuals = regressor @ unknowns - deflections  # (T, 3)
        return np.asarray(np.linalg.norm(residuals, axis=1))

    def with_target_weights(self, weights: FloatArray) -> Part:
        """Return the part for weighted least squares, in which target t counts with the factor weights[t].

        The factor multiplies the squared residual of the target. Only the compressed rows, `triangle`, are
        weighted: the rows `targets` remain as they are.

        Args:
            weights: (T,) positive factors.
        """
        weighted_rows = np.sqrt(weights)[:, None, None] * self.targets  # (T, 3, P + K + 1)
        flat = weighted_rows.reshape(-1, weighted_rows.shape[-1])
        return replace(self, triangle=compute_triangular_factor(flat))


def compress_parts(
    rows: Rows, columns: Columns, parts: Sequence[IndexArray], statements: Statements | None = None
) -> tuple[Part, ...]:
    """Compress the least-squares rows of each of several parts of a measurement set by QR decomposition.

    One pass over the set, some hundred observations at a time, needs little memory.

    Args:
        rows: N observations.
        columns: columns of the richest elastic model.
        parts: ascending indices of the observations of each part, such as a fold of a cross-validation.
        statements: systematic errors with a prior, which are fitted together with the compliances; None
            without any.

    Raises:
        MeasurementError: a covariance is not positive definite.
    """
    statements = statements or Statements.none(rows.robot.n)
    builders = [_PartBuilder(rows, part) for part in parts]
    start = 0  # index of the block's first observation in the set
    for block_rows in generate_elastic_rows(rows, columns, statements):
        stop = start + len(block_rows.targets)
        whitened = block_rows.whiten()
        for builder in builders:
            builder.add(whitened, start, stop)
        start = stop
    return tuple(builder.build(statements, columns) for builder in builders)


class _PartBuilder:
    """Collector of the rows of one part, block by block."""

    def __init__(self, rows: Rows, part: IndexArray) -> None:
        """Start without rows; `part` are the ascending indices of the part's observations among the rows."""
        self._part = part
        self._measurements = rows.measurements[part]
        self._factors = list[FloatArray]()  # QR factor of the rows [A B d] of each block
        self._targets = list[FloatArray]()  # (targets of a block, 3, P + K + 1) their rows [A B d]
        self._squared_levers = np.zeros(rows.robot.n + 1)  # sums for each joint frame and the base [m²]
        self._reading_count = 0
        self._keeps_targets = int(self._measurements.present.sum()) <= MOST_TARGETS

    def add(self, whitened: BlockRows, start: int, stop: int) -> None:
        """Add the rows of those observations of a block that belong to the part.

        Args:
            whitened: whitened rows of the observations from index `start` to `stop` of the set.
            start: index of the block's first observation in the set.
            stop: index after its last observation.
        """
        in_part = select_rows_of_part(self._part, start, stop)  # indices in the block
        rows = whitened.flat[in_part]  # (observations, rows of each, P + K + 1)
        self._factors.append(compute_triangular_factor(rows.reshape(-1, rows.shape[-1])))
        self._reading_count += int(whitened.read[in_part].sum())
        if self._keeps_targets:
            was_read = whitened.block.measurements.present[in_part]
            self._targets.append(whitened.targets[in_part][was_read])
        # Vectors (observations, n + 1, 3) from the origin of each joint's frame and the base's, which is the
        # last, to the load point [m].
        _, _, to_load_point = whitened.block.frames
        self._squared_levers += np.square(to_load_point[in_part]).sum(axis=(0, 2))

    def build(self, statements: Statements, columns: Columns) -> Part:
        """Return the part of the measurement set whose rows were added.

        Args:
            statements: systematic errors with a prior, whose columns B are in the rows [A B d].
            columns: layout of the columns A of the compliances.
        """
        factors = np.concatenate(self._factors)  # QR factors of all blocks, below each other
        all_columns = factors.shape[1]  # P + K + 1
        triangle = Triangle(unknowns=all_columns - 1)
        triangle.add(factors)
        no_targets = np.zeros((0, 3, all_columns))
        return Part(
            triangle=triangle.R,
            sums=self._sum_up(),
            targets=np.concatenate([no_targets, *self._targets]),
            statements=statements,
            compliances=columns.width,
        )

    def _sum_up(self) -> Sums:
        """Return the counts and sums over all observations of the part."""
        measurements = self._measurements
        return Sums(
            observations=len(measurements),
            readings=self._reading_count,
            targets=int(measurements.present.sum()),
            squared_force=float(np.square(measurements.force).sum()),
            squared_moment=float(np.square(measurements.moment).sum()),
            squared_levers=self._squared_levers,
            squared_deflection=float(np.square(measurements.deflection).sum()),
        )


def select_rows_of_part(part: IndexArray, start: int, stop: int) -> IndexArray:
    """Return those of ascending indices `part` that are in [start, stop), counted from `start`.

    Args:
        part: ascending indices of the observations of a part of a measurement set.
        start: index of the first observation of a block of the set.
        stop: index after the last observation of the block.
    """
    first, last = np.searchsorted(part, [start, stop])
    return np.asarray(part[first:last] - start)


def generate_elastic_rows(
    rows: Rows, columns: Columns, statements: Statements | None = None
) -> Iterator[BlockRows]:
    """Yield the least-squares rows [A B d] of all elastic elements, some hundred observations at a time.

    A are the P columns of compliances, B the K columns of systematic errors with a prior, d the readings. The
    rows are in metres and radians, not whitened.
    """
    statements = statements or Statements.none(rows.robot.n)
    is_one_block = len(rows) <= _BLOCK
    for start in range(0, len(rows), _BLOCK):
        # A set of one block is not sliced, as a slice would lose the kinematics that are already computed.
        block = rows if is_one_block else rows[start : start + _BLOCK]
        yield from statements.generate(block, columns.terms, whitened=False)
