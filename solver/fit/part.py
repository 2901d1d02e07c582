"""Parts of a campaign, such as folds: their rows for elastic models, compressed once (method.md §7)."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import Final

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
class Size:
    """Sums over observations that determine the scale of the penalty."""

    configurations: int  #: number of observations
    readings: int  #: number of coordinates and encoders that were read
    targets: int  #: number of targets that were read
    force: float  #: sum over the observations of ‖F‖² [N²]
    moment: float  #: sum over the observations of ‖M‖² [N²·m²]
    #: (n + 1,) sum of the squared distances of the load point from the origins of the joint frames and, as
    #: the last number, of the base [m²]
    lever: FloatArray
    deflection: float  #: sum over the targets of ‖δp‖² [m²]

    @classmethod
    def add(cls, sizes: Sequence[Size]) -> Size:
        """Return the sums over all observations of several sizes."""
        return cls(**{each.name: sum(getattr(size, each.name) for size in sizes) for each in fields(cls)})


@dataclass(frozen=True, eq=False)
class Part:
    """Rows of some observations for all elastic models, compressed.

    The columns A of P compliances come first, then the columns B of K stated errors, in units of their
    standard uncertainties, then the readings d.
    """

    #: (P + K + 1, P + K + 1) with ``TᵀT`` the Gram matrix of the rows [A B d], whitened in units of sigma
    triangle: FloatArray
    size: Size
    #: (T, 3, P + K + 1) whitened rows [A B d] of each target, which a robust loss needs; T = 0 for more than
    #: `MOST_TARGETS` targets
    targets: FloatArray
    statements: Statements  #: statements with K unknowns, and the prior of the compliances
    compliances: int  #: number P of columns of compliances

    @classmethod
    def merge(cls, parts: Sequence[Part]) -> Part:
        """Merge several parts of a set; sums of squares are added, so that no digits are lost.

        The rows of single targets are dropped if they become too many.
        """
        size = Size.add([part.size for part in parts])
        targets = np.concatenate([part.targets for part in parts])
        triangle = compute_triangular_factor(np.concatenate([part.triangle for part in parts]))
        kept = targets if size.targets <= MOST_TARGETS else targets[:0]
        return replace(parts[0], triangle=triangle, size=size, targets=kept)

    def with_sigma(self, sigma: float) -> Part:
        """Return the part with statements weighted by another standard uncertainty of a reading [m]."""
        return replace(self, statements=replace(self.statements, sigma=sigma))

    @property
    def stated_errors(self) -> int:
        """Number K of stated errors."""
        return int(self.triangle.shape[1]) - 1 - self.compliances

    @cached_property
    def stated(self) -> FloatArray:
        """Rows (q, P + K + 1) of what is stated: first that K errors are zero, then priors."""
        return self.statements.build_rows(self.compliances, self.stated_errors)

    @cached_property
    def _with_errors_fitted(self) -> tuple[FloatArray, FloatArray]:
        """Triangle (P + 1, P + 1) with stated errors projected out, and the map (K, P + 1) to these errors.

        Each stated error has a row like a reading: the error is zero, within its standard uncertainty.
        """
        P, K = self.compliances, self.stated_errors
        errors, others = slice(P, P + K), [*range(P), P + K]
        rows = np.vstack([self.triangle, self.stated])
        factor = compute_triangular_factor(np.hstack([rows[:, errors], rows[:, others]]))
        return factor[K:, K:], np.asarray(np.linalg.solve(factor[:K, :K], factor[:K, K:]), dtype=np.float64)

    @property
    def with_errors_fitted(self) -> FloatArray:
        """Triangle (P + 1, P + 1) of the rows [A d]: a fit to it equals a fit with the stated errors free.

        The errors are free within their standard uncertainties.
        """
        return self._with_errors_fitted[0] if len(self.stated) else self.triangle

    @property
    def count(self) -> int:
        """Number of readings and of stated compliances."""
        return self.size.readings + len(self.stated) - self.stated_errors

    def append_fitted_errors(self, compliances: FloatArray) -> FloatArray:
        """Return compliances (..., P), followed by the stated errors (..., K) that fit best in squares."""
        if not self.stated_errors:
            return compliances
        to_errors = self._with_errors_fitted[1]
        errors = to_errors[:, -1] - compliances @ to_errors[:, :-1].T
        return np.concatenate([compliances, errors], axis=-1)

    def compute_residual_norms(self, unknowns: FloatArray) -> FloatArray:
        """Return the norms (T,) [m] of each target's whitened residual at unknowns (P + K,)."""
        residuals = self.targets[..., :-1] @ unknowns - self.targets[..., -1]
        return np.asarray(np.linalg.norm(residuals, axis=1))

    def weigh_targets(self, weight: FloatArray) -> Part:
        """Return the part with a triangle in which the squares of the T targets have weights (T,).

        The rows `targets` stay unweighted.
        """
        rows = np.sqrt(weight)[:, None, None] * self.targets
        return replace(self, triangle=compute_triangular_factor(rows.reshape(-1, rows.shape[-1])))


def compress_parts(
    rows: Rows, columns: Columns, parts: Sequence[IndexArray], statements: Statements | None = None
) -> tuple[Part, ...]:
    """Compress the rows of each of several parts of a measurement set, in one pass with little memory.

    Args:
        rows: N observations.
        columns: columns of the richest model.
        parts: ascending indices of the observations of each part.
        statements: stated errors that are fitted together with the compliances; None without any.

    Raises:
        MeasurementError: a covariance is not positive definite.
    """
    statements = statements or Statements.none(rows.robot.n)
    builders = [_PartBuilder(rows, part) for part in parts]
    start = 0  # index of the first observation of the block
    for of_block in generate_elastic_rows(rows, columns, statements):
        whitened = of_block.whiten()
        stop = start + len(of_block.targets)
        for builder in builders:
            builder.add(whitened, start, stop)
        start = stop
    return tuple(builder.build(statements, columns) for builder in builders)


class _PartBuilder:
    """Collector of the rows of one part, block by block."""

    def __init__(self, rows: Rows, part: IndexArray) -> None:
        """Start without rows; `part` are the ascending indices of the part's observations."""
        self._measurements, self._part = rows.measurements[part], part
        self._factors = list[FloatArray]()
        self._targets = list[FloatArray]()
        self._lever, self._readings = np.zeros(rows.robot.n + 1), 0
        self._keeps_targets = int(self._measurements.present.sum()) <= MOST_TARGETS

    def add(self, whitened: BlockRows, start: int, stop: int) -> None:
        """Add the whitened rows of those observations from `start` to `stop` that belong to the part."""
        in_part = select_rows_of_part(self._part, start, stop)
        targets, block = whitened.targets[in_part], whitened.block
        all_rows = whitened.flat[in_part].reshape(-1, targets.shape[-1])
        self._factors.append(compute_triangular_factor(all_rows))
        self._readings += int(whitened.read[in_part].sum())
        if self._keeps_targets:
            self._targets.append(targets[block.measurements.present[in_part]])
        _, _, to_load_point = block.frames  # (B, n + 1, 3) from the origin of each frame [m]
        self._lever += np.square(to_load_point[in_part]).sum(axis=(0, 2))

    def build(self, statements: Statements, columns: Columns) -> Part:
        """Return the part."""
        measurements, factors = self._measurements, np.concatenate(self._factors)
        width = factors.shape[1]
        triangle = Triangle(unknowns=width - 1)
        triangle.add(factors)
        size = Size(
            configurations=len(measurements),
            readings=self._readings,
            targets=int(measurements.present.sum()),
            force=float(np.square(measurements.force).sum()),
            moment=float(np.square(measurements.moment).sum()),
            lever=self._lever,
            deflection=float(np.square(measurements.deflection).sum()),
        )
        targets = np.concatenate([np.zeros((0, 3, width)), *self._targets])
        return Part(triangle.R, size, targets, statements, columns.width)


def select_rows_of_part(part: IndexArray, start: int, stop: int) -> IndexArray:
    """Return the rows of a block of observations that belong to a part of the measurement set.

    Args:
        part: ascending indices of the observations of the part.
        start: index of the first observation of the block.
        stop: index after the last observation of the block.

    Returns:
        Indices of the rows, counted from the start of the block.
    """
    first, last = np.searchsorted(part, [start, stop])
    return np.asarray(part[first:last] - start)


def generate_elastic_rows(
    rows: Rows, columns: Columns, statements: Statements | None = None
) -> Iterator[BlockRows]:
    """Yield the rows of blocks of observations, not whitened.

    P columns of compliances come first, then K columns of stated errors, then the readings.
    """
    statements = statements or Statements.none(rows.robot.n)
    for start in range(0, len(rows), _BLOCK):
        part = rows[start : start + _BLOCK] if len(rows) > _BLOCK else rows
        yield from statements.generate(part, columns.terms, whitened=False)
