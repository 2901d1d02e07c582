"""The face of a cone on which an optimum lies: which scalars are zero, and what rank each block has.

On a face the program is smooth. Matrices of rank r around ``X = U X_r Uᵀ`` are, to second order,
``X + U A Uᵀ + U B Vᵀ + V Bᵀ Uᵀ + V Bᵀ X_r⁻¹ B Vᵀ`` with any small symmetric A and any small B; the last term
meets the slack ``V S_s Vᵀ`` and bends the objective by ``tr(S_s Bᵀ X_r⁻¹ B)`` (Shapiro, *Perturbation
analysis of optimization problems in Banach spaces*, 1992). That gives Newton's method, which an interior
point's answer is polished with, and the derivative of the fit by the readings.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np

from jointstiff.solver.arrays import FloatArray, IndexArray
from jointstiff.solver.convex.semidefinite.cone import SemidefiniteProgram, to_matrix, to_vector

_SMALL = 1e-3
"""Compliance, in the program's units, that is negligible for explaining the readings."""
_ROUNDING = 1e-12
"""Tolerance relative to the largest entry: a smaller eigenvalue counts as zero."""
_RIDGE = 1e-13
"""Regularisation of the Hessian, relative to its largest diagonal entry: undetermined directions stay put."""


@dataclass(frozen=True, eq=False)
class _BlockFace:
    """Face of one block: X = U X_r Uᵀ with slack V S_s Vᵀ."""

    place: slice
    U: FloatArray
    V: FloatArray
    core: FloatArray
    slack: FloatArray

    @property
    def rank(self) -> int:
        """Return the rank of the block."""
        return int(self.U.shape[1])

    @cached_property
    def basis(self) -> FloatArray:
        """(q, d) orthonormal tangent vectors: those of A, then those of B, row by row."""
        U, V = self.U, self.V
        within = [
            (np.outer(U[:, i], U[:, j]) + np.outer(U[:, j], U[:, i])) / (2.0 if i == j else np.sqrt(2.0))
            for i in range(self.rank)
            for j in range(i + 1)
        ]
        across = [(np.outer(u, v) + np.outer(v, u)) / np.sqrt(2.0) for u in self.U.T for v in V.T]
        matrices = [*within, *across]
        size = len(U) * (len(U) + 1) // 2
        return to_vector(np.array(matrices)).T if matrices else np.zeros((size, 0))

    @cached_property
    def curvature(self) -> FloatArray:
        """(d, d) what the slack adds to the Hessian."""
        d, inner = self.basis.shape[1], self.rank * (self.rank + 1) // 2
        out = np.zeros((d, d))
        if self.rank:
            out[inner:, inner:] = np.kron(np.linalg.inv(self.core), self.slack)
        return out

    def moved(self, step: FloatArray) -> FloatArray | None:
        """Return the block after a step (d,), with the same rank; None if that leaves the cone."""
        tangent = to_matrix(self.basis @ step, len(self.U))
        core = self.core + self.U.T @ tangent @ self.U
        if self.rank and np.linalg.eigvalsh(core).min() <= 0.0:
            return None
        half = self.U @ core + self.V @ (self.V.T @ tangent @ self.U)
        return to_vector(half @ np.linalg.solve(core, half.T)) if self.rank else np.zeros(len(self.basis))


@dataclass(frozen=True, eq=False)
class Face:
    """Around a point x of a program."""

    program: SemidefiniteProgram  #: the program
    x: FloatArray  #: (p,) the point
    free: IndexArray  #: scalars that are not zero
    blocks: tuple[_BlockFace, ...]  #: the faces of the blocks

    @cached_property
    def basis(self) -> FloatArray:
        """(p, d) tangent vectors: the free scalars', then those of the blocks."""
        columns = np.zeros((len(self.x), len(self.free) + sum(b.basis.shape[1] for b in self.blocks)))
        columns[self.free, np.arange(len(self.free))] = 1.0
        for block, place in zip(self.blocks, self._places, strict=True):
            columns[block.place, place] = block.basis
        return columns

    @cached_property
    def information(self) -> FloatArray:
        """(d, d) what the readings say of the tangent vectors: 2 RᵀR."""
        R = self.program.fit.R @ self.basis
        gram: FloatArray = 2.0 * R.T @ R
        return gram

    @cached_property
    def hessian(self) -> FloatArray:
        """(d, d) of the objective on the face."""
        hessian = self.information.copy()
        for block, place in zip(self.blocks, self._places, strict=True):
            hessian[place, place] += block.curvature
        hessian[np.diag_indices_from(hessian)] += _RIDGE * hessian.diagonal().max(initial=0.0)
        return hessian

    @property
    def _places(self) -> list[slice]:
        """Tangent coordinates of each block."""
        ends = np.cumsum([len(self.free), *(block.basis.shape[1] for block in self.blocks)]).tolist()
        return [slice(start, stop) for start, stop in pairwise(ends)]

    def shares(self, coordinates: FloatArray) -> FloatArray:
        """(p,) numbers of the tangent coordinates (d,), each block's sum at its first parameter."""
        out = np.zeros(len(self.x))
        out[self.free] = coordinates[: len(self.free)]
        for block, place in zip(self.blocks, self._places, strict=True):
            out[block.place.start] = coordinates[place].sum()
        return out

    def step(self) -> FloatArray | None:
        """The point after a step of Newton's method; None if that leaves the face or does not exist."""
        gradient = self.basis.T @ self.program.slack(self.x)
        try:
            step: FloatArray = np.asarray(np.linalg.solve(self.hessian, -gradient), dtype=np.float64)
        except np.linalg.LinAlgError:
            return None
        out = np.zeros(len(self.x))
        out[self.free] = self.x[self.free] + step[: len(self.free)]
        for block, place in zip(self.blocks, self._places, strict=True):
            moved = block.moved(step[place])
            if moved is None:
                return None
            out[block.place] = moved
        return out if np.isfinite(out).all() and (out[self.free] >= 0.0).all() else None


def face_at(program: SemidefiniteProgram, x: FloatArray) -> Face:
    """The face that a point near the optimum is next to: what exceeds its slack is not zero.

    Args:
        program: the program.
        x: (p,) feasible.
    """
    slack, cone = program.slack(x), program.cone
    free = np.flatnonzero(x[: cone.nonnegative] > slack[: cone.nonnegative])
    largest = max(_SMALL, float(np.abs(x[cone.nonnegative :]).max(initial=0.0)))
    on_face, split = np.zeros(len(x)), []
    on_face[free] = x[free]
    for size, place in cone.blocks():
        X, S = to_matrix(x[place], size), to_matrix(slack[place], size)
        values, vectors = np.linalg.eigh(X)
        exceeds = np.linalg.eigvalsh(X - largest / program.weight * S) > 0.0
        rank = min(int(exceeds.sum()), int((values > _ROUNDING * largest).sum()))
        values, U, V = values[size - rank :], vectors[:, size - rank :], vectors[:, : size - rank]
        on_face[place] = to_vector((U * values) @ U.T)
        split.append((place, U, V, values))
    slack = program.slack(on_face)
    blocks = tuple(
        _BlockFace(place, U, V, np.diag(values), _definite(V.T @ to_matrix(slack[place], len(U)) @ V))
        for place, U, V, values in split
    )
    return Face(program, on_face, free, blocks)


def _definite(S: FloatArray) -> FloatArray:
    """The nearest positive semidefinite matrix: what a slack is at the optimum."""
    values, vectors = np.linalg.eigh(S)
    return np.asarray((vectors * np.maximum(values, 0.0)) @ vectors.T)


def polished(program: SemidefiniteProgram, x: FloatArray) -> FloatArray | None:
    """A step of Newton's method on the face next to a point, or None where there is none.

    The certificate of the outcome decides whether it is any better.
    """
    return face_at(program, x).step()


def effective_freedom(program: SemidefiniteProgram, x: FloatArray) -> FloatArray:
    """Return the effective number of parameters: the divergence of the fitted readings (Stein 1981).

    ``Σ_k ∂(R x)_k / ∂z_k = tr(H⁻¹ 2 RᵀR)`` on the face of the optimum, H with the bend of the penalty.

    Args:
        program: the program.
        x: (p,) its optimum.

    Returns:
        (p,) the trace's share of each scalar, and of each block at its first parameter.
    """
    face = face_at(program, x)
    if not face.basis.shape[1]:
        return np.zeros(len(x))
    return face.shares(np.diagonal(np.linalg.solve(face.hessian, face.information)))
