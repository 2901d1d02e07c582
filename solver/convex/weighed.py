"""Least squares over cones of products, and the ends of linear functions near the optimum, certified.

Clarabel proposes; a bound from the dual, evaluated in the data by `Cones.least`, decides. Whatever x:

    ‖A y − b‖² ≥ ‖A x − b‖² + 2 gᵀ(y − x),   g = Aᵀ(A x − b): the excess is at most 2 (gᵀx − min gᵀy)
    aᵀy ≥ uᵀb − ‖u‖ + min (a − Aᵀu)ᵀy   for all y with ‖A y − b‖ ≤ 1, for any u

Cones of products c η of a compliance with unknowns in a box, and bounds on what they hold.

Unknowns π in a box and in balls, each multiplied by its joint's own c ≥ 0, lie in a convex cone: the
perspective of that set (Boyd & Vandenberghe 2004, §3.2.6). In units of the half-widths a block of x is

    (c, ζ, ν)   with   0 ≤ c ≤ cap,   |ζ_k| ≤ c,   ‖ν_g‖ ≤ c + ratio_g ζ_own(g)

A linear function s of a block is at least ``cap · min(0, s_c − h(s))`` there, h the support function of the
set at c = 1. So any residual gives a bound on an optimum, feasible or not, by arithmetic alone:
`Cones.least`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.convex import programs
from jointstiff.solver.convex.certificate import Certificate
from jointstiff.solver.errors import SolverError


@dataclass(frozen=True)
class Block:
    """Unknowns of one joint: c, then the boxes' ζ, then three ν for each ball."""

    boxes: int  #: number of ζ
    #: for each ball: index of the ζ by which its radius grows, −1 for none, and by how much beside c
    balls: tuple[tuple[int, float], ...] = ()

    @property
    def size(self) -> int:
        """Return the number of unknowns."""
        return 1 + self.boxes + 3 * len(self.balls)


@dataclass(frozen=True, eq=False)
class Cones:
    """The set of x: blocks with the greatest c of each."""

    blocks: tuple[Block, ...]  #: one for each joint
    cap: FloatArray  #: (n,) greatest c, in the unit of x

    @property
    def first(self) -> FloatArray:
        """Return the indices (n,) of the blocks' c."""
        sizes = [block.size for block in self.blocks]
        return np.cumsum([0, *sizes[:-1]])

    def least(self, s: FloatArray) -> float:
        """Return the least value of sᵀx over the set, zero or negative, in closed form."""
        total = 0.0
        for start, block, cap in zip(self.first.tolist(), self.blocks, self.cap.tolist(), strict=True):
            zeta = s[start + 1 : start + 1 + block.boxes].copy()
            nu = s[start + 1 + block.boxes : start + block.size].reshape(-1, 3)
            pulls = np.linalg.norm(nu, axis=1)
            for (own, ratio), pull in zip(block.balls, pulls.tolist(), strict=True):
                if own >= 0:
                    zeta[own] -= ratio * pull
            total += cap * min(0.0, float(s[start] - np.abs(zeta).sum() - pulls.sum()))
        return total

    def projected(self, x: FloatArray) -> FloatArray:
        """Return a point of the set near x: what lies outside is drawn in, block by block."""
        x = x.copy()
        for start, block, cap in zip(self.first.tolist(), self.blocks, self.cap.tolist(), strict=True):
            c = x[start] = min(max(x[start], 0.0), cap)
            box = slice(start + 1, start + 1 + block.boxes)
            x[box] = np.clip(x[box], -c, c)
            for ball, (own, ratio) in enumerate(block.balls):
                part = slice(box.stop + 3 * ball, box.stop + 3 * ball + 3)
                reach = c + (ratio * x[start + 1 + own] if own >= 0 else 0.0)
                x[part] *= min(1.0, reach / max(float(np.linalg.norm(x[part])), 1e-300))
        return x


GAP: Final = 1e-8
"""Greatest excess of an objective over the optimum, with ‖b‖ = 1, that a certificate lets pass."""
_LEAST_RADIUS: Final = 1e-6
"""Radius of the ball of `ends`, beside ‖b‖, below which Clarabel's rounding shows: exact readings."""
_LADDER: Final = (1e-10, 1e-9, 1e-8)
"""Tolerances of Clarabel, tried in this order."""


@dataclass(frozen=True, eq=False)
class Weighed:
    """The optimum of `least_squares`, with its evidence."""

    x: FloatArray  #: (p,) in the set
    loss: float  #: ‖A x − b‖²
    #: its gap is the greatest excess of the loss over the optimum, with ‖b‖ = 1; its multipliers (rows,) are
    #: those of the equations that define the residuals
    certificate: Certificate


def least_squares(A: FloatArray, b: FloatArray, cones: Cones) -> Weighed:
    """Solve ``minimise ‖A x − b‖²`` over the set, and prove it.

    Args:
        A: (rows, p).
        b: (rows,), not zero.
        cones: of x, in units in which it is about ‖b‖.

    Raises:
        SolverError: no answer is certified.
    """
    size = float(np.linalg.norm(b)) or 1.0
    program = programs.weighed(len(b), cones.blocks)
    best: Weighed | None = None
    for tolerance in _LADDER:
        found = program.solve({"A": A, "b": b / size, "cap": cones.cap / size}, tolerance)
        if found is None:
            continue
        x = cones.projected(size * found)
        residual = A @ x - b
        gradient = A.T @ residual
        outside = -2.0 * cones.least(gradient) / size**2
        gap = outside + 2.0 * float(gradient @ x) / size**2
        if best is None or gap < best.certificate.gap:
            evidence = Certificate(0.0, outside, gap, residual / size, "clarabel")
            best = Weighed(x, float(residual @ residual), evidence)
        if best.certificate.is_optimal(GAP):
            return best
    raise SolverError(
        "the fit of compliances and weights could not be certified"
        + ("" if best is None else f": its gap is {best.certificate.gap:.1g}"),
        remedy="please report this problem, with the data",
    )


@dataclass(frozen=True, eq=False)
class Ends:
    """Least and greatest c of each block where ‖A x − b‖² is near its optimum; outer bounds."""

    ends: FloatArray  #: (n, 2) bounds from the dual; NaN where Clarabel has no answer
    gap: FloatArray  #: (n, 2) distance of each to the value of Clarabel's point, beside c's range


def ends(A: FloatArray, b: FloatArray, optimum: Weighed, rise: float, cones: Cones) -> Ends:
    """Bound each block's c over the points of the set with ``‖A x − b‖² ≤ loss + rise``.

    Every point has a c of at most the bounds found so far, which sharpens the others.

    Args:
        A: (rows, p).
        b: (rows,).
        optimum: of `least_squares`.
        rise: of the loss, positive.
        cones: of x.
    """
    radius = max(float(np.sqrt(optimum.loss + rise)), _LEAST_RADIUS * float(np.linalg.norm(b)))
    program = programs.weighed_end(len(b), cones.blocks)
    data = {"A": A, "b": (b - A @ optimum.x) / radius, "near": optimum.x / radius, "cap": cones.cap / radius}
    values, duals = np.full((len(cones.cap), 2), np.nan), {}
    for j, side in np.ndindex(values.shape):
        a = np.zeros(len(optimum.x))
        a[cones.first[j]] = size = (1.0, -1.0)[side]
        for tolerance in _LADDER:
            found = program.solve_with_duals({"a": a, **data}, tolerance)
            if found is not None:
                values[j, side] = size * (a @ optimum.x + radius * (a @ found[0]))
                duals[j, side] = a, found[1][1 : 1 + len(b)]
                break
    bounds, cap = np.full(values.shape, np.nan), cones.cap
    for _ in range(2):
        for (j, side), (a, u) in duals.items():
            least = u @ b - radius * float(np.linalg.norm(u)) + Cones(cones.blocks, cap).least(a - A.T @ u)
            bounds[j, side] = least if side == 0 else -least
        cap = np.fmin(cap, bounds[:, 1])
    bounds[:, 0] = np.fmax(bounds[:, 0], 0.0)
    gap = np.array([1.0, -1.0]) * (np.clip(values, 0.0, None) - bounds)
    return Ends(bounds, gap / (bounds[:, 1:] - bounds[:, :1]))
