"""Cones of products c η of a compliance with unknowns in a box, and bounds on what they hold.

Unknowns π in a box and in balls, each multiplied by its joint's own c ≥ 0, lie in a convex cone: the
perspective of that set (Boyd & Vandenberghe 2004, §3.2.6). In units of the half-widths a block of x is

    (c, ζ, ν)   with   0 ≤ c ≤ cap,   |ζ_k| ≤ c,   ‖ν_g‖ ≤ c + ratio_g ζ_own(g)

A linear function s of a block is at least ``cap · min(0, s_c − h(s))`` there, h the support function of the
set at c = 1. So any residual gives a bound on an optimum, feasible or not, by arithmetic alone:
`Cones.least`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from jointstiff.solver.arrays import FloatArray


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
            for (box, ratio), pull in zip(block.balls, pulls.tolist(), strict=True):
                if box >= 0:
                    zeta[box] -= ratio * pull
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
