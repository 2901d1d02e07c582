"""Candidate readings, by the information that each adds (method.md §10).

Candidate i is a posture with its load; reading it adds ``K_i = A_iᵀ Σ⁻¹ A_i``, p × p. Where a force may act
in any direction, A_i is linear in the force, ``A_i(F) = Σ_a F_a A_ia``, and so the price of the candidate,
``⟨G, K_i(F)⟩``, is a quadratic form of F: its greatest value over all directions is an eigenvalue of a 3 × 3.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
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


class Candidates(ABC):
    """N candidate readings of p parameters."""

    @property
    @abstractmethod
    def parameters(self) -> int:
        """Return p."""

    @property
    def free(self) -> bool:
        """Return whether forces may act in all directions."""
        return False

    @abstractmethod
    def __len__(self) -> int:
        """Return N."""

    @abstractmethod
    def __getitem__(self, rows: IndexArray | slice) -> Candidates:
        """Some of them, in the given order."""

    @abstractmethod
    def prices(self, G: FloatArray) -> FloatArray:
        """Return the greatest ``⟨G, K_i⟩`` of each candidate over the loads that it may take.

        Args:
            G: (p, p) symmetric.

        Returns:
            (N,).
        """

    @abstractmethod
    def atoms(self, index: IndexArray, G: FloatArray) -> Atoms:
        """Return some candidates, each under its load of the greatest ``⟨G, K_i⟩``."""

    @abstractmethod
    def under(self, index: IndexArray, force: FloatArray) -> Atoms:
        """Return some candidates under forces along unit vectors (k, 3), or under loads of their own."""

    @abstractmethod
    def total(self) -> FloatArray:
        """Return the sum of all information (p, p), of forces along all three axes where they are free."""


class PackedCandidates(Candidates):
    """Candidates as the entries of their information on and above the diagonal: 168 bytes for six joints.

    Where the force is free there are six such matrices, of all pairs of axes: K(F) = Σ_ab F_a F_b K_ab.
    """

    def __init__(self, packed: FloatArray, parameters: int) -> None:
        """Take information that is packed already.

        Args:
            packed: (N, 1, p (p + 1) / 2) entries of K_i row by row, or (N, 6, …) of (K_ab + K_ba) / 2 for the
                pairs of axes xx, xy, xz, yy, yz, zz under the greatest force.
            parameters: p.

        Raises:
            RequestError: there is none, or a number is not finite.
        """
        if not len(packed) or not np.isfinite(packed).all():
            raise RequestError(
                "there is no candidate, or a number of one is not finite",
                where="candidates",
                remedy="give at least one posture with a finite load",
            )
        self._packed = packed
        self._parameters = parameters
        self._rows, self._columns = np.triu_indices(parameters)
        self._twice = np.where(self._rows == self._columns, 1.0, 2.0)

    @classmethod
    def from_rows(cls, rows: FloatArray) -> PackedCandidates:
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

    @property
    def parameters(self) -> int:
        """Return p."""
        return self._parameters

    @property
    def free(self) -> bool:
        """Return whether forces may act in all directions."""
        return bool(self._packed.shape[1] > 1)

    def __len__(self) -> int:
        return len(self._packed)

    def __getitem__(self, rows: IndexArray | slice) -> PackedCandidates:
        """Some of them, in the given order."""
        return PackedCandidates(self._packed[rows], self._parameters)

    def prices(self, G: FloatArray) -> FloatArray:
        """Return the greatest ``⟨G, K_i⟩`` (N,) over all directions of the force."""
        return (
            greatest_eigenvalue(self._forms(slice(None), G))
            if self.free
            else self._products(slice(None), G)[:, 0]
        )

    def atoms(self, index: IndexArray, G: FloatArray) -> Atoms:
        """Return some candidates, each under its load of the greatest ``⟨G, K_i⟩``."""
        force = np.zeros((len(index), 3))
        if self.free:
            force = np.linalg.eigh(self._forms(index, G))[1][:, :, -1]
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
        information = np.empty((len(index), self._parameters, self._parameters))
        information[:, self._rows, self._columns] = entries
        information[:, self._columns, self._rows] = entries
        return Atoms(index, force, information)

    def total(self) -> FloatArray:
        """Return the sum of all information (p, p), of forces along all three axes where they are free."""
        axes = [0, 3, 5] if self.free else [0]
        total = np.empty((self._parameters, self._parameters))
        sums = np.sum([np.ones(len(self)) @ self._packed[:, axis] for axis in axes], axis=0)
        total[self._rows, self._columns] = total[self._columns, self._rows] = sums
        return total

    def _products(self, index: IndexArray | slice, G: FloatArray) -> FloatArray:
        products: FloatArray = self._packed[index] @ (self._twice * G[self._rows, self._columns])
        return products

    def _forms(self, index: IndexArray | slice, G: FloatArray) -> FloatArray:
        """Return the quadratic forms of the force ⟨G, K_ab⟩ (N, 3, 3)."""
        a, b = np.triu_indices(3)
        products = self._products(index, G)
        forms = np.empty((len(products), 3, 3))
        forms[:, a, b] = forms[:, b, a] = products
        return forms


class ScaledCandidates(Candidates):
    """Candidates of parameters measured in other units; nothing is copied."""

    def __init__(self, candidates: Candidates, unit: FloatArray) -> None:
        """Take candidates.

        Args:
            candidates: of p parameters.
            unit: (p,) by which the columns are multiplied.
        """
        self._candidates = candidates
        self._unit = unit
        self._squares = np.outer(unit, unit)

    @property
    def parameters(self) -> int:
        """Return p."""
        return len(self._unit)

    @property
    def free(self) -> bool:
        """Return whether forces may act in all directions."""
        return self._candidates.free

    def __len__(self) -> int:
        return len(self._candidates)

    def __getitem__(self, rows: IndexArray | slice) -> ScaledCandidates:
        """Some of them, in the given order."""
        return ScaledCandidates(self._candidates[rows], self._unit)

    def prices(self, G: FloatArray) -> FloatArray:
        """Return the greatest ``⟨G, K_i⟩`` (N,)."""
        return self._candidates.prices(G * self._squares)

    def atoms(self, index: IndexArray, G: FloatArray) -> Atoms:
        """Return some candidates, each under its load of the greatest ``⟨G, K_i⟩``."""
        atoms = self._candidates.atoms(index, G * self._squares)
        return Atoms(atoms.index, atoms.force, atoms.information * self._squares)

    def under(self, index: IndexArray, force: FloatArray) -> Atoms:
        """Return some candidates under forces along unit vectors (k, 3), or under loads of their own."""
        atoms = self._candidates.under(index, force)
        return Atoms(atoms.index, atoms.force, atoms.information * self._squares)

    def total(self) -> FloatArray:
        """Return the sum of all information (p, p)."""
        total: FloatArray = self._candidates.total() * self._squares
        return total


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
