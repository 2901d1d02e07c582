"""Cones of parameters by their shape: scalars, matrices, and products of compliances with masses.

The vector of a symmetric matrix has the upper triangle column by column, with off-diagonal entries times √2.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from jointstiff.solver.arrays import BoolArray, FloatArray, IndexArray
from jointstiff.solver.fit.constraints import TOLERANCE, Bounds, Constraints, Inequalities
from jointstiff.solver.mechanics.springs import triangle_indices, triangle_weights


def find_diagonal_entries(size: int) -> IndexArray:
    """Return the indices (size,) of a matrix's diagonal entries in the vector of its upper triangle."""
    rows, columns = triangle_indices(size)
    return np.flatnonzero(rows == columns)


def to_matrix(vector: FloatArray, size: int) -> FloatArray:
    """Return the symmetric matrices (..., size, size) of vectors (..., size (size + 1) / 2).

    A vector has the upper triangle column by column, with off-diagonal entries times √2.
    """
    rows, columns = triangle_indices(size)
    upper_triangle = vector / triangle_weights(size)
    matrix = np.empty((*vector.shape[:-1], size, size))
    matrix[..., rows, columns] = upper_triangle
    matrix[..., columns, rows] = upper_triangle
    return matrix


def to_vector(matrix: FloatArray) -> FloatArray:
    """Return symmetric matrices (..., size, size) as vectors (..., size (size + 1) / 2).

    A vector has the upper triangle column by column, with off-diagonal entries times √2, so that the vector
    has the length of the matrix.
    """
    size = matrix.shape[-1]
    rows, columns = triangle_indices(size)
    upper_triangle = matrix[..., rows, columns]
    return np.asarray(upper_triangle * triangle_weights(size))


def lift_diagonal(vector: FloatArray, size: int) -> FloatArray:
    """Return a symmetric matrix with its diagonal increased until no computed eigenvalue is negative.

    The increase only removes rounding: a few parts in 10¹⁶ of the greatest eigenvalue.

    Args:
        vector: (size (size + 1) / 2,) the matrix, as the vector of its upper triangle.
        size: number of rows of the matrix.
    """
    diagonal = find_diagonal_entries(size)
    increase = np.finfo(float).eps * float(np.abs(vector).max(initial=0.0))
    lifted = vector
    while np.linalg.eigvalsh(to_matrix(lifted, size)).min() < 0.0:
        lifted = vector.copy()
        lifted[diagonal] += increase
        increase *= 2.0
    return lifted


@dataclass(frozen=True, eq=False)
class Scalars:
    """Cone of scalars: each within its bounds, with linear inequalities among them if there are any."""

    bounds: Bounds  #: bounds of the n scalars
    inequalities: Inequalities | None = None  #: further inequalities; None if there are none

    @classmethod
    def of(cls, constraints: Constraints) -> Scalars:
        """Return the scalars within the bounds of the constraints, in the order that they state."""
        return cls(constraints.bounds, constraints.inequalities)

    @property
    def inequality_count(self) -> int:
        """Number of inequalities in addition to the bounds."""
        return 0 if self.inequalities is None else len(self.inequalities.least)

    def in_units(self, unit: FloatArray) -> Scalars:
        """Return the cone of the scaled variables ``x = c / unit`` (n,), with rows of unit norm.

        Rows are those of the inequalities; the norm of a bound's row is that of its variable.
        """
        bounds = self.bounds.in_units(unit)
        if self.inequalities is None:
            return Scalars(bounds)
        matrix = self.inequalities.matrix * unit
        row_norms = np.linalg.norm(matrix, axis=1)
        scaled = Inequalities(matrix / row_norms[:, None], self.inequalities.least / row_norms)
        return Scalars(bounds, scaled)

    @cached_property
    def rows(self) -> tuple[FloatArray, FloatArray]:
        """All constraints as ``G x ≥ h``: G (k, n), rows of bounds before inequalities, and h (k,)."""
        lower, upper = self.bounds.lower, self.bounds.upper
        has_lower, has_upper = np.isfinite(lower), np.isfinite(upper)
        identity = np.eye(len(lower))
        G = [identity[has_lower], -identity[has_upper]]
        h = [lower[has_lower], -upper[has_upper]]
        if self.inequalities is not None:
            G.append(self.inequalities.matrix)
            h.append(self.inequalities.least)
        return np.vstack(G), np.concatenate(h)

    def find_tight_rows(self, x: FloatArray, slack: float = TOLERANCE) -> BoolArray:
        """Return a mask (k,) of the constraints ``G x ≥ h`` that hold with equality at a feasible x.

        Args:
            x: (n,) scalars that satisfy the constraints.
            slack: largest ``G x − h`` that counts as equality, relative to max(1, ‖x‖∞).
        """
        G, h = self.rows
        largest_slack = slack * max(1.0, float(np.abs(x).max()))
        return np.asarray(G @ x - h <= largest_slack)


@dataclass(frozen=True)
class Matrices:
    """Layout of a vector of parameters: first scalars ≥ 0, then blocks, positive semidefinite matrices."""

    nonnegative: int  #: number of scalars, which come first and are zero or positive
    sizes: tuple[int, ...] = ()  #: number of rows of each block; blocks are stored as vectors (`to_vector`)
    penalised: int = 0  #: number of scalars at the end that are penalised, like the traces of the blocks

    @property
    def dimension(self) -> int:
        """Number of parameters."""
        return self.nonnegative + sum(size * (size + 1) // 2 for size in self.sizes)

    @property
    def unpenalised(self) -> int:
        """Number of scalars without a penalty, such as compliances of joints; they come first."""
        return self.nonnegative - self.penalised

    @property
    def has_penalty(self) -> bool:
        """Return whether a parameter is penalised; if not, all are scalars that are zero or positive."""
        return self.penalised > 0 or len(self.sizes) > 0

    def blocks(self) -> Iterator[tuple[int, slice]]:
        """Yield each block's number of rows and the slice of the parameters that contains the block."""
        start = self.nonnegative
        for size in self.sizes:
            stop = start + size * (size + 1) // 2
            yield size, slice(start, stop)
            start = stop

    def least_value(self, x: FloatArray) -> float:
        """Return the least number among the scalars and the blocks' eigenvalues of x (p,); inf if p = 0.

        The number is negative if x lies outside the cone.
        """
        values = [x[: self.nonnegative]]
        for size, place in self.blocks():
            eigenvalues = np.linalg.eigvalsh(to_matrix(x[place], size))
            values.append(np.asarray(eigenvalues))
        return float(np.concatenate(values).min(initial=np.inf))

    def project(self, x: FloatArray) -> FloatArray:
        """Return the point (p,) of the cone nearest to x (p,).

        The diagonal is then raised by the rounding of an eigenvalue, so that no computed one is negative.
        """
        projected = np.maximum(x, 0.0)  # correct for the scalars; the blocks are replaced below
        for size, place in self.blocks():
            eigenvalues, vectors = np.linalg.eigh(to_matrix(x[place], size))
            matrix = (vectors * np.maximum(eigenvalues, 0.0)) @ vectors.T
            projected[place] = lift_diagonal(to_vector(matrix), size)
        return projected

    def penalty(self, weight: float) -> FloatArray:
        """Return the gradient (p,) of the penalty on penalised scalars and on the traces of blocks.

        The gradient is `weight` at penalised scalars and diagonal entries of blocks, and zero elsewhere.
        """
        gradient = np.zeros(self.dimension)
        penalised_scalars = slice(self.unpenalised, self.nonnegative)
        gradient[penalised_scalars] = weight
        for size, place in self.blocks():
            gradient[place.start + find_diagonal_entries(size)] = weight
        return gradient


class BlockEntries(NamedTuple):
    """Entries of one joint's unknowns in a vector, as views of the vector."""

    c: FloatArray  #: (1,) compliance c
    zeta: FloatArray  #: (boxes,) ζ
    nu: FloatArray  #: (balls, 3) ν


@dataclass(frozen=True)
class Block:
    """Layout of one joint's unknowns: compliance c, then ζ limited by a box, then ν (3,) in each ball.

    The limits are |ζ_k| ≤ c, and ‖ν‖ ≤ radius for each ball.
    """

    boxes: int  #: number of ζ
    #: for each ball: index k of a ζ, or −1, and ratio: the radius is c + ratio ζ_k, or c for the index −1
    balls: tuple[tuple[int, float], ...] = ()

    @property
    def size(self) -> int:
        """Number of unknowns of the joint."""
        return 1 + self.boxes + 3 * len(self.balls)

    def split(self, vector: FloatArray) -> BlockEntries:
        """Return the entries c, ζ and ν of a vector (size,)."""
        first_of_nu = 1 + self.boxes
        c, zeta, nu = vector[:1], vector[1:first_of_nu], vector[first_of_nu:]
        return BlockEntries(c, zeta, nu.reshape(-1, 3))


@dataclass(frozen=True, eq=False)
class WithMasses:
    """Set of the products c π of compliances c and unknown masses and moments π, one block for each joint.

    Unknowns π in a box and in balls, each multiplied by its joint's own c ≥ 0, lie in a convex cone: the
    perspective of that set (Boyd & Vandenberghe 2004, §3.2.6). In units of the half-widths a block of x is

        (c, ζ, ν)   with   0 ≤ c ≤ cap,   |ζ_k| ≤ c,   ‖ν_g‖ ≤ c + ratio_g ζ_k(g)

    ζ_k is c times the deviation of a mass, or of a balancer's constant, from the middle of the bounds. ν_g
    (3,) is c times mass times displacement of a centre of mass. The radius of ball g grows with mass k(g).
    """

    blocks: tuple[Block, ...]  #: one for each joint
    cap: FloatArray  #: (n,) greatest c, in the unit of x

    @property
    def first(self) -> FloatArray:
        """Indices (n,) of each block's compliance c in x."""
        sizes = [block.size for block in self.blocks]
        return np.cumsum([0, *sizes[:-1]])

    def _split(self, x: FloatArray) -> Iterator[tuple[Block, float, BlockEntries]]:
        """Yield for each joint its block, its greatest compliance, and its entries of x (p,), as views of x.

        A block is the layout of the joint's entries.
        """
        start = 0
        for block, cap in zip(self.blocks, self.cap.tolist(), strict=True):
            yield block, cap, block.split(x[start : start + block.size])
            start += block.size

    def minimise_linear_function(self, s: FloatArray) -> float:
        """Return the least value of the linear function sᵀx over the set: zero or negative, in closed form.

        The least value over a joint's block (c, ζ, ν) is in proportion to its compliance c, so c is zero or
        the cap.
        """
        total = 0.0
        for block, cap, coefficients in self._split(s):
            total += cap * min(0.0, _minimise_over_block(block, coefficients))
        return total

    def move_into_set(self, x: FloatArray) -> FloatArray:
        """Return a point (p,) of the set near x (p,): entries beyond a limit are moved onto it.

        A block of x is (c, ζ, ν) with 0 ≤ c ≤ cap, |ζ_k| ≤ c, and ‖ν_g‖ ≤ c + ratio ζ_k for each ball g.
        """
        moved = x.copy()
        for block, cap, entries in self._split(moved):  # the entries are views of `moved`
            entries.c[0] = c = min(max(entries.c[0], 0.0), cap)
            entries.zeta[:] = np.clip(entries.zeta, -c, c)
            for nu, (k, ratio) in zip(entries.nu, block.balls, strict=True):
                radius_depends_on_zeta = k >= 0
                radius = c + ratio * entries.zeta[k] if radius_depends_on_zeta else c
                length = max(float(np.linalg.norm(nu)), 1e-300)
                nu *= min(1.0, radius / length)
        return moved


def _minimise_over_block(block: Block, coefficients: BlockEntries) -> float:
    """Return the least value of ``s_c c + s_ζᵀζ + s_νᵀν`` over the block (c, ζ, ν) of a joint with c = 1.

    Then |ζ_k| ≤ 1, and ‖ν_g‖ ≤ 1 + ratio_g ζ_k for each ball g. The least s_νᵀν_g is
    ``−(1 + ratio_g ζ_k) ‖s_ν‖``, which leaves a linear function of ζ; the least of it is minus the sum of its
    coefficients' magnitudes.

    Args:
        block: number of ζ, and for each ball the index k and the ratio.
        coefficients: s_c, s_ζ and s_ν.
    """
    ball_norms = np.linalg.norm(coefficients.nu, axis=1)
    zeta_coefficients = coefficients.zeta.copy()
    for (k, ratio), norm in zip(block.balls, ball_norms.tolist(), strict=True):
        radius_depends_on_zeta = k >= 0
        if radius_depends_on_zeta:
            zeta_coefficients[k] -= ratio * norm
    least_of_zeta, least_of_nu = -np.abs(zeta_coefficients).sum(), -ball_norms.sum()
    return float(coefficients.c[0] + least_of_zeta + least_of_nu)
