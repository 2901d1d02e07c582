"""Stack: whitened readings and columns of terms, posture by posture.

The rows M_i = [A_i d_i] of each observation i are stored apart, so that observations can be left out,
weighted, or selected from a certain observation on; a triangle compresses the rows of any selection.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import accumulate

import numpy as np

from jointstiff.solver.arrays import BoolArray, FloatArray, IndexArray, unit_columns
from jointstiff.solver.fit.triangle import Triangle, orthonormal_basis


@dataclass(frozen=True, eq=False)
class Stack:
    """Rows of N observations; their K columns belong to named terms, and a last column holds the readings."""

    #: (N, m, K + 1) [A d] in units of sigma, the column of readings last; zero where nothing was read
    rows: FloatArray
    read: IndexArray  #: (N,) number of coordinates that were read in each observation
    widths: dict[str, int]  #: number of columns of each term, by the term's name, in the order of the columns

    def __len__(self) -> int:
        return len(self.rows)

    def __getitem__(self, part: IndexArray | BoolArray | slice) -> Stack:
        """Return the stack of some observations, in the given order; an observation may be repeated."""
        return replace(self, rows=self.rows[part], read=self.read[part])

    def without(self, observation: int) -> Stack:
        """Return the stack without one observation, given by its index."""
        return self[np.delete(np.arange(len(self)), observation)]

    @property
    def flat(self) -> FloatArray:
        """Rows of all observations as one matrix (N m, K + 1); the readings are its last column."""
        return self.rows.reshape(-1, self.rows.shape[-1])

    @property
    def span(self) -> dict[str, IndexArray]:
        """Indices of the columns of each term, by the name of the term."""
        columns = dict[str, IndexArray]()
        first = 0
        for name, width in self.widths.items():
            columns[name] = np.arange(first, first + width)
            first += width
        return columns

    @cached_property
    def grams(self) -> FloatArray:
        """Gram matrices (N, K + 1, K + 1) ``M_iᵀ M_i`` of the rows of each observation i."""
        return np.asarray(self.rows.mT @ self.rows)

    @property
    def trailing_gram_sums(self) -> FloatArray:
        """Sums (N, K + 1, K + 1): entry i adds the Gram matrices of observation i and all later ones."""
        last_first = accumulate(self.grams[::-1])  # np.cumsum along the first axis lasts ten times as long
        return np.array([*last_first])[::-1]

    def triangle(self) -> Triangle:
        """Compress all rows [A d] to the triangular factor R of their QR decomposition.

        A fit to R has the same solution as a fit to the rows.
        """
        triangle = Triangle(**self.widths)
        triangle.add(self.rows, count=int(self.read.sum()))
        return triangle

    def scale_to_unit_columns(self) -> tuple[Stack, FloatArray]:
        """Return the stack with every column scaled to unit length, and the original lengths (K + 1,)."""
        scaled_rows, lengths = unit_columns(self.flat)
        return replace(self, rows=scaled_rows.reshape(self.rows.shape)), lengths

    def in_units(self, units: Mapping[str, float]) -> Stack:
        """Return the stack with other units of the unknowns of some terms.

        A column is the effect of one unit of an unknown, so that it is multiplied by the new unit.

        Args:
            units: name of a term → new unit of its unknowns, measured in the present unit.
        """
        factors = np.ones(self.rows.shape[-1])  # of all columns, the readings last
        for name, new_unit in units.items():
            factors[self.span[name]] = new_unit
        return replace(self, rows=self.rows * factors)

    def project_out(self, names: Sequence[str]) -> Stack:
        """Return the stack without the columns of the named terms, after projecting them out of all others.

        The others lose their component in the span of the named columns. A fit to the result equals a fit to
        all columns in which the unknowns of the named terms are free.
        """
        named_columns = np.concatenate([self.span[name] for name in names])
        scaled_columns, _ = unit_columns(self.flat[:, named_columns])
        basis = orthonormal_basis(scaled_columns)  # Q of the span of the named columns
        others = np.delete(self.flat, named_columns, axis=1)
        others = others - basis @ (basis.T @ others)  # (I − Q Qᵀ) of the other columns
        widths = {name: width for name, width in self.widths.items() if name not in names}
        observations, rows_each, _ = self.rows.shape
        return replace(self, rows=others.reshape(observations, rows_each, -1), widths=widths)
