"""Angle about the tool axis along a path: the best on a grid, by dynamic programming (method.md §12).

Five-axis work on six axes leaves the angle ψ about the tool's axis free. At each of S steps the nodes are
the angles of a grid with the branches of the inverse kinematics; two nodes of neighbouring steps are joined
where no joint turns by more than a limit. The least sum of costs over all paths is found exactly
(Bellman 1957).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from jointstiff.solver.arrays import BoolArray, FloatArray, IndexArray
from jointstiff.solver.errors import RequestError

_SLACK: Final = 1e-9
"""Widening of a window that only preselects [rad]."""


@dataclass(frozen=True, eq=False)
class PathNodes:
    """Postures to choose from.

    Raises:
        RequestError: shapes disagree, a cost is NaN, or a limit is not positive.
    """

    #: (S, A, B, n) joint angles of B branches at A tool angles at S steps [rad]; NaN where there is none. A
    #: joint that can reach an angle after a full turn, too, has a branch for each.
    joints: FloatArray
    #: (S, A, B) cost of each, such as a deflection [m]; inf where a posture is not to be used
    cost: FloatArray
    largest_turn: FloatArray  #: (n,) greatest change of each joint from step to step [rad]

    def __post_init__(self) -> None:
        fits = self.joints.ndim == 4 and self.cost.shape == self.joints.shape[:3] and self.joints.size > 0
        if not fits or self.largest_turn.shape != self.joints.shape[3:]:
            raise RequestError(
                f"joints of shape {self.joints.shape}, costs of {self.cost.shape} and limits of "
                f"{self.largest_turn.shape} do not go together",
                where="path",
                remedy="give (S, A, B, n), (S, A, B) and (n,)",
            )
        if np.isnan(self.cost).any() or not (self.largest_turn > 0.0).all():
            raise RequestError(
                "a cost is NaN, or a joint may not turn at all",
                where="path",
                remedy="give inf for postures that are not to be used, and positive limits",
            )

    @property
    def usable(self) -> BoolArray:
        """(S, A, B) postures that exist and have a finite cost."""
        return np.asarray(np.isfinite(self.cost) & ~np.isnan(self.joints).any(axis=-1))


@dataclass(frozen=True, eq=False)
class ToolAnglePath:
    """A path through the nodes."""

    angle: IndexArray  #: (S,) index of the tool angle at each step
    branch: IndexArray  #: (S,) index of the branch
    cost: FloatArray  #: (S,) of the nodes on the path
    #: mean of the steps' least costs: no path has a lower mean, whatever the joints may do
    lower_bound: float

    @property
    def mean(self) -> float:
        """Mean cost."""
        return float(self.cost.mean())


def best_path(nodes: PathNodes) -> ToolAnglePath:
    """Find the path of least mean cost.

    Args:
        nodes: S steps.

    Returns:
        The path, exact on its grid.

    Raises:
        RequestError: no path reaches some step, which is named.
    """
    usable = [np.flatnonzero(step) for step in nodes.usable.reshape(len(nodes.cost), -1)]
    joints = nodes.joints.reshape(len(nodes.cost), -1, nodes.joints.shape[3])
    cost = nodes.cost.reshape(len(nodes.cost), -1)
    value, came_from = cost[0][usable[0]], []
    _refuse_unreached(0, value)
    for step in range(1, len(cost)):
        before, after = joints[step - 1][usable[step - 1]], joints[step][usable[step]]
        least, parent = _least_before(value, before, after, nodes.largest_turn)
        value = least + cost[step][usable[step]]
        came_from.append(parent)
        _refuse_unreached(step, value)
    chosen = [int(np.argmin(value))]
    for parent in reversed(came_from):
        chosen.append(int(parent[chosen[-1]]))
    flat = np.array([usable[step][k] for step, k in enumerate(reversed(chosen))])
    angle, branch = np.divmod(flat, nodes.cost.shape[2])
    least_costs = [cost[step][places].min() for step, places in enumerate(usable)]
    return ToolAnglePath(angle, branch, cost[np.arange(len(cost)), flat], float(np.mean(least_costs)))


def best_constant_angle(nodes: PathNodes) -> ToolAnglePath | None:
    """Find the best path that keeps its tool angle; None where no angle can be kept."""
    found = []
    for a in range(nodes.cost.shape[1]):
        one = PathNodes(nodes.joints[:, a : a + 1], nodes.cost[:, a : a + 1], nodes.largest_turn)
        try:
            path = best_path(one)
        except RequestError:  # this angle cannot be kept
            continue
        found.append(ToolAnglePath(path.angle + a, path.branch, path.cost, path.lower_bound))
    return min(found, key=lambda path: path.mean, default=None)


def _least_before(
    value: FloatArray, before: FloatArray, after: FloatArray, largest_turn: FloatArray
) -> tuple[FloatArray, IndexArray]:
    """Return the least value (q,) of the nodes before (p, n) joined to each node after (q, n), and which."""
    target, source = _pairs_near(before, after, largest_turn)
    for j in range(before.shape[1]):
        near = np.abs(after[target, j] - before[source, j]) <= largest_turn[j]
        target, source = target[near], source[near]
    least, parent = np.full(len(after), np.inf), np.zeros(len(after), dtype=np.intp)
    if len(target):
        order = np.lexsort((value[source], target))
        reached, first = np.unique(target[order], return_index=True)
        parent[reached] = source[order][first]
        least[reached] = value[parent[reached]]
    return least, parent


def _pairs_near(
    before: FloatArray, after: FloatArray, largest_turn: FloatArray
) -> tuple[IndexArray, IndexArray]:
    """Return pairs of nodes after and before that are near in the joint that spreads most."""
    j = int(np.argmax(np.ptp(before, axis=0) / largest_turn)) if len(before) else 0
    order = np.argsort(before[:, j])
    reach = largest_turn[j] * (1.0 + _SLACK) + _SLACK
    first = np.searchsorted(before[order, j], after[:, j] - reach)
    count = np.searchsorted(before[order, j], after[:, j] + reach, side="right") - first
    target = np.repeat(np.arange(len(after)), count)
    within = np.arange(len(target)) - np.repeat(np.cumsum(count) - count, count)
    return target, order[np.repeat(first, count) + within]


def _refuse_unreached(step: int, value: FloatArray) -> None:
    if not np.isfinite(value).any():
        raise RequestError(
            f"no posture of step {step + 1} can be reached",
            where=f"path[{step}]",
            remedy="allow greater turns from step to step, a finer grid of angles, or shorter steps",
        )
