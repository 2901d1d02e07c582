"""Candidate readings, by the information that each adds (method.md §10).

Candidate i is a posture with its load; reading it adds ``K_i = A_iᵀ Σ⁻¹ A_i``, p × p. Where a force may act
in any direction, A_i is linear in the force, ``A_i(F) = Σ_a F_a A_ia``, and so the price of the candidate,
``⟨G, K_i(F)⟩``, is a quadratic form of F: its greatest value over all directions is an eigenvalue of a 3 × 3.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from jointstiff.solver.arrays import FloatArray, IndexArray
from jointstiff.solver.errors import RequestError

_BLOCK: Final = 1024
"""Candidates packed at a time: what a cache holds."""


@dataclass(frozen=True, eq=False)
class Atoms:
    """Some candidates, each under one load."""

    index: IndexArray  #: (k,) candidates
    force: FloatArray  #: (k, 3) unit direction of the force where it is free; zeros for a load of its own
    information: FloatArray  #: (k, p, p)

    def __len__(self) -> int:
        return len(self.index)

    def __getitem__(self, rows: IndexArray | slice) -> Atoms:
        """Some of them, in the given order."""
        return Atoms(self.index[rows], self.force[rows], self.information[rows])

    @classmethod
    def of(cls, parts: Sequence[Atoms]) -> Atoms:
        """Return the atoms of all parts, in order."""
        return cls(
            np.concatenate([part.index for part in parts]),
            np.concatenate([part.force for part in parts]),
            np.concatenate([part.information for part in parts]),
        )

    def joined(self, others: Atoms) -> Atoms:
        """Return these and then the others."""
        return Atoms.of([self, others])


class Candidates:
    """N candidate readings of p parameters: the entries of their information on and above the diagonal.

    That takes 168 bytes for six joints. Where the force is free there are six such matrices, of all pairs of
    axes: K(F) = Σ_ab F_a F_b K_ab.
    """

    def __init__(self, packed: FloatArray, parameters: int, unit: FloatArray | None = None) -> None:
        """Take information that is packed already.

        Args:
            packed: (N, 1, p (p + 1) / 2) entries of K_i row by row, or (N, 6, …) of (K_ab + K_ba) / 2 for the
                pairs of axes xx, xy, xz, yy, yz, zz under the greatest force.
            parameters: p.
            unit: (p,) by which the columns of the rows are multiplied; 1 if None.

        Raises:
            RequestError: there is none, or a number is not finite.
        """
        if not len(packed) or not np.isfinite(packed).all():
            raise RequestError(
                "there are no candidates, or one has a number that is not finite",
                where="candidates",
                remedy="give at least one posture with a finite load",
            )
        self.parameters = parameters
        self.free = packed.shape[1] > 1  #: whether forces may act in all directions
        self._packed = packed
        self._rows, self._columns = np.triu_indices(parameters)
        self._unit = np.ones(parameters) if unit is None else unit
        self._squares = self._unit[self._rows] * self._unit[self._columns]

    @classmethod
    def from_rows(cls, rows: FloatArray) -> Candidates:
        """Pack rows, block by block.

        Args:
            rows: (N, m, p) whitened, under a load of their own; or (N, 3, m, p), under the greatest
                force along each axis, for forces of any direction.
        """
        p = rows.shape[-1]
        stack = rows[:, None] if rows.ndim == 3 else rows
        pairs = [(a, b) for a in range(stack.shape[1]) for b in range(a, stack.shape[1])]
        packed = np.empty((len(rows), len(pairs), p * (p + 1) // 2))
        for start in range(0, len(rows), _BLOCK):
            # Candidates last: sums over them run along the memory.
            block = np.ascontiguousarray(stack[start : start + _BLOCK].transpose(1, 3, 2, 0))
            for e, (a, b) in enumerate(pairs):
                K = _upper_products(block[a], block[b])
                packed[start : start + _BLOCK, e] = (
                    K if a == b else 0.5 * (K + _upper_products(block[b], block[a]))
                ).T
        return cls(packed, p)

    def scaled(self, unit: FloatArray) -> Candidates:
        """Return the same candidates of parameters in other units (p,); nothing is copied."""
        return Candidates(self._packed, self.parameters, self._unit * unit)

    def __len__(self) -> int:
        return len(self._packed)

    def __getitem__(self, rows: IndexArray | slice) -> Candidates:
        """Some of them, in the given order."""
        return Candidates(self._packed[rows], self.parameters, self._unit)

    def prices(self, G: FloatArray) -> FloatArray:
        """Return the greatest ``⟨G, K_i⟩`` (N,) of each candidate over the loads that it may take.

        Args:
            G: (p, p) symmetric.
        """
        products = self._products(slice(None), G)
        return greatest_eigenvalue(_forms(products)) if self.free else products[:, 0]

    def atoms(self, index: IndexArray, G: FloatArray) -> Atoms:
        """Return some candidates, each under its load of the greatest ``⟨G, K_i⟩``."""
        force = np.zeros((len(index), 3))
        if self.free:
            force = np.linalg.eigh(_forms(self._products(index, G)))[1][:, :, -1]
        return self.under(index, force)

    def under(self, index: IndexArray, force: FloatArray) -> Atoms:
        """Return some candidates under forces along unit vectors (k, 3), or under loads of their own."""
        packed = self._packed[index]
        if self.free:
            a, b = np.triu_indices(3)
            squares = force[:, a] * force[:, b] * np.where(a == b, 1.0, 2.0)
            entries = np.einsum("ie,ieq->iq", squares, packed)
        else:
            entries = packed[:, 0]
        return Atoms(index, force, self._unpacked(entries))

    def total(self) -> FloatArray:
        """Return the sum of all information (p, p), of forces along all three axes where they are free."""
        axes = [0, 3, 5] if self.free else [0]
        return self._unpacked(np.sum([np.ones(len(self)) @ self._packed[:, axis] for axis in axes], axis=0))

    def _unpacked(self, entries: FloatArray) -> FloatArray:
        """Return symmetric matrices (..., p, p) of entries on and above the diagonal, in the units."""
        matrices = np.empty((*entries.shape[:-1], self.parameters, self.parameters))
        matrices[..., self._rows, self._columns] = entries * self._squares
        matrices[..., self._columns, self._rows] = entries * self._squares
        return matrices

    def _products(self, index: IndexArray | slice, G: FloatArray) -> FloatArray:
        twice = np.where(self._rows == self._columns, 1.0, 2.0)
        products: FloatArray = self._packed[index] @ (twice * self._squares * G[self._rows, self._columns])
        return products


def _forms(products: FloatArray) -> FloatArray:
    """Return the quadratic forms of the force ⟨G, K_ab⟩ (N, 3, 3), of products (N, 6)."""
    a, b = np.triu_indices(3)
    forms = np.empty((len(products), 3, 3))
    forms[:, a, b] = forms[:, b, a] = products
    return forms


def _upper_products(left: FloatArray, right: FloatArray) -> FloatArray:
    """Return the entries on and above the diagonal of leftᵀ right, row by row.

    Args:
        left: (p, m, N).
        right: (p, m, N).

    Returns:
        (p (p + 1) / 2, N).
    """
    return np.concatenate([np.einsum("mn,cmn->cn", left[j], right[j:]) for j in range(len(left))])


def greatest_eigenvalue(matrices: FloatArray) -> FloatArray:
    """Return the greatest eigenvalue of symmetric 3 × 3 matrices, in closed form.

    ``λ = q + 2 r cos(arccos(det(B)/2)/3)`` with q = tr(A)/3, 6 r² = ‖A − q I‖² and
    B = (A − q I)/r (Smith 1961).

    Args:
        matrices: (..., 3, 3).

    Returns:
        (...).
    """
    mean = np.trace(matrices, axis1=-2, axis2=-1) / 3.0
    B = matrices - mean[..., None, None] * np.eye(3)
    r = np.sqrt(np.square(B).sum(axis=(-2, -1)) / 6.0)
    B /= np.where(r > 0.0, r, 1.0)[..., None, None]
    half = 0.5 * (B[..., 0, :] * np.cross(B[..., 1, :], B[..., 2, :])).sum(axis=-1)
    greatest: FloatArray = mean + 2.0 * r * np.cos(np.arccos(np.clip(half, -1.0, 1.0)) / 3.0)
    return greatest
