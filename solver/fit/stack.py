"""Stack: whitened readings and columns of terms, posture by posture.

The rows M_i = [A_i d_i] of each observation i are stored apart, so that observations can be left out,
weighted, or selected from a certain observation on; a triangle compresses the rows of any selection.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import accumulate, pairwise

import numpy as np

from jointstiff.solver.arrays import BoolArray, FloatArray, IndexArray
from jointstiff.solver.fit.triangle import Triangle, orthonormal_basis, unit_columns


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
        bounds = accumulate(self.widths.values(), initial=0)
        return {name: np.arange(*part) for name, part in zip(self.widths, pairwise(bounds), strict=True)}

    @cached_property
    def grams(self) -> FloatArray:
        """Gram matrices (N, K + 1, K + 1) ``M_iᵀ M_i`` of the rows of each observation i."""
        return np.asarray(self.rows.mT @ self.rows)

    @property
    def trailing_gram_sums(self) -> FloatArray:
        """Sums (N, K + 1, K + 1): entry i adds the Gram matrices of observation i and all later ones."""
        return np.asarray(np.cumsum(self.grams[::-1], axis=0)[::-1])

    def triangle(self) -> Triangle:
        """Return the compressed rows: the triangular factor of all rows."""
        triangle = Triangle(**self.widths)
        triangle.add(self.rows, count=int(self.read.sum()))
        return triangle

    def scale_to_unit_columns(self) -> tuple[Stack, FloatArray]:
        """Return the stack with every column scaled to unit length, and the original lengths (K + 1,)."""
        unit, length = unit_columns(self.flat)
        return replace(self, rows=unit.reshape(self.rows.shape)), length

    def in_units(self, units: Mapping[str, float]) -> Stack:
        """Return the stack with other units of the unknowns of some terms; the units multiply their columns.

        Args:
            units: name of a term → new unit of its unknowns, measured in the present unit.
        """
        unit = np.ones(self.rows.shape[-1])
        for name, unit_of_term in units.items():
            unit[self.span[name]] = unit_of_term
        return replace(self, rows=self.rows * unit)

    def project_out(self, names: Sequence[str]) -> Stack:
        """Return the stack without the named terms, which are projected out of all other columns.

        A fit to the result equals a fit in which the named terms are free.
        """
        projected_columns = np.concatenate([self.span[name] for name in names])
        basis = orthonormal_basis(unit_columns(self.flat[:, projected_columns])[0])
        remaining = np.delete(self.flat, projected_columns, axis=1)
        remaining = remaining - basis @ (basis.T @ remaining)
        widths = {name: width for name, width in self.widths.items() if name not in names}
        return replace(self, rows=remaining.reshape(*self.rows.shape[:2], -1), widths=widths)
