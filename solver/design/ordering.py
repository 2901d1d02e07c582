"""Order of readings: few changes of the load, and little travel between postures."""

from __future__ import annotations

import numpy as np

from jointstiff.solver.arrays import FloatArray, IndexArray


def ordered(joints: FloatArray, group: IndexArray) -> IndexArray:
    """Order readings group by group, each by the nearest next posture, improved by reversing parts.

    Args:
        joints: (n, q) [rad].
        group: (n,) of equal loads.

    Returns:
        (n,) order. Travel is the greatest change of a joint's angle from one posture to the next.
    """
    order: list[int] = []
    for each in np.unique(group):
        members = np.flatnonzero(group == each)
        start = joints[order[-1]] if order else np.zeros(joints.shape[1])
        order += _tour(joints, members, start)
    return np.array(order, dtype=np.intp)


def travel(joints: FloatArray) -> float:
    """Return the sum of the greatest joint moves from one posture to the next [rad]."""
    return float(np.abs(np.diff(joints, axis=0)).max(axis=1).sum())


def _tour(joints: FloatArray, members: IndexArray, start: FloatArray) -> list[int]:
    places = np.vstack([start, joints[members]])
    distance = np.abs(places[:, None] - places).max(axis=2)
    left, path = set(range(1, len(places))), [0]
    while left:
        path.append(min(left, key=lambda i: distance[path[-1], i]))
        left.remove(path[-1])
    improved = True
    while improved:
        improved = False
        for i in range(1, len(path) - 1):
            for j in range(i + 1, len(path)):
                before = distance[path[i - 1], path[i]]
                after = distance[path[i - 1], path[j]]
                if j + 1 < len(path):
                    before += distance[path[j], path[j + 1]]
                    after += distance[path[i], path[j + 1]]
                if after < before - 1e-9:
                    path[i : j + 1] = path[i : j + 1][::-1]
                    improved = True
    return [int(members[i - 1]) for i in path[1:]]
