"""Combinations of compliances: those that alone show in the readings, and the one that shows least."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from jointstiff.solver.arrays import FloatArray, IndexArray

JointIndices = IndexArray

_PARTICIPATES = 1e-6
"""Component of a unit vector in a null space above which a joint belongs to a combination."""
_MATTERS = 0.1
"""Coefficient relative to the largest below which it is not mentioned."""
_UNSPOKEN = 0.005
"""Coefficient that vanishes when two digits are printed."""


@dataclass(frozen=True, eq=False)
class Combination:
    """Joints whose compliances appear in the readings only together."""

    joints: tuple[int, ...]  #: m of them
    #: (m − k, m) what the readings do show of them, k being the number of directions that they do not: sums
    #: of the compliances, one a row, in reduced echelon form. Dimensionless.
    seen: FloatArray

    def in_words(self, names: tuple[str, ...]) -> str:
        """The sums that show, such as ``c(joint_4) + 0.8 c(joint_6)``."""
        return " and ".join(_sum_in_words(row, self.joints, names) for row in self.seen)

    def reason(self, names: tuple[str, ...]) -> str:
        """Return why these joints have no stiffness, with the remedy."""
        together = ", ".join(names[joint] for joint in self.joints)
        return (
            f"only a combination of {together} is observable, {self.in_words(names)}: add postures in "
            "which their axes differ"
        )


@dataclass(frozen=True, eq=False)
class WeakDirection:
    """The change of the compliances that shows least."""

    joints: tuple[int, ...]  #: m that matter in it
    #: (m,) change of their compliances, the largest of size 1, the first positive. Dimensionless.
    change: FloatArray
    #: how many times less it shows than what shows best, each joint's column brought to unit norm: the
    #: condition number
    attenuation: float

    def in_words(self, names: tuple[str, ...]) -> str:
        """Return which joints are hard to distinguish, and in which ratio."""
        together = ", ".join(names[joint] for joint in self.joints)
        change = " : ".join(f"{part:+.2g}" for part in self.change)
        return (
            f"{together} are hard to distinguish: a change of their compliances in the ratio {change} "
            f"has {self.attenuation:.2g} times less effect on the readings than the most visible change"
        )


def combinations(null_space: FloatArray, scale: FloatArray, columns: JointIndices) -> tuple[Combination, ...]:
    """Split a null space into groups of joints that do not mix.

    Args:
        null_space: (k, p) orthonormal directions that the equilibrated regressor does not see.
        scale: (p,) norms of the regressor's columns, by which it was equilibrated.
        columns: (p,) the joint of each column.
    """
    return tuple(_combination(null_space, scale, group, columns) for group in _groups(null_space))


def weak_direction(
    direction: FloatArray, scale: FloatArray, columns: JointIndices, attenuation: float
) -> WeakDirection:
    """Translate a right singular vector into compliances.

    Args:
        direction: (p,) of the least singular value of the equilibrated regressor.
        scale: (p,) norms of the regressor's columns, by which it was equilibrated.
        columns: (p,) the joint of each column.
        attenuation: condition number.
    """
    parts = np.flatnonzero(np.abs(direction) > _MATTERS * np.abs(direction).max())
    change = direction[parts] / scale[parts]
    # The sign of a singular vector is arbitrary: the first joint's part counts as a rise.
    change = change * (np.sign(change[0]) / np.abs(change).max())
    return WeakDirection(tuple(int(columns[i]) for i in parts), change, attenuation)


def _groups(null_space: FloatArray) -> list[JointIndices]:
    """Split the coordinates that take part in a null space (k, p) into independent groups.

    The projector onto the null space does not depend on its basis, and it is block diagonal over
    groups that do not mix.
    """
    if not len(null_space):
        return []
    linked = np.abs(null_space.T @ null_space) > _PARTICIPATES
    _, labels = connected_components(coo_array(linked), directed=False)
    involved = linked.diagonal()
    return [np.flatnonzero((labels == label) & involved) for label in np.unique(labels[involved])]


def _combination(
    null_space: FloatArray, scale: FloatArray, group: JointIndices, columns: JointIndices
) -> Combination:
    """Return what the readings show of a group: the sums of compliances that no null direction changes.

    With the null directions ν (k, m) and k of the joints set free, a row ``w = e_i + Σ_f w_f e_f`` shows
    if ``ν w = 0``, that is ``w_f = −ν_f⁻¹ ν_i``.
    """
    members = null_space[:, group]
    values, vectors = np.linalg.eigh(members.T @ members)  # a projector: its values are 0 or 1
    null = vectors[:, values > 0.5].T
    # As many independent columns as `null` (k, m) has rows: the last ones that serve, rather than the
    # largest, so that rounding does not choose between equals
    rest, pivots = null, list[int]()
    for _ in range(len(null)):
        norms = np.linalg.norm(rest, axis=0)
        last = int(np.flatnonzero(norms > _MATTERS * norms.max())[-1])
        along = rest[:, last] / norms[last]
        rest = rest - np.outer(along, along @ rest)
        pivots.append(last)
    free = sorted(pivots)
    bound = np.setdiff1d(np.arange(len(group)), free)
    null = null / (scale[group] / scale[group].max())  # of the compliances themselves
    seen = np.zeros((len(bound), len(group)))
    seen[np.arange(len(bound)), bound] = 1.0
    seen[:, free] = -np.linalg.solve(null[:, free], null[:, bound]).T
    return Combination(tuple(int(columns[i]) for i in group), seen)


def _sum_in_words(row: FloatArray, joints: tuple[int, ...], names: tuple[str, ...]) -> str:
    words = ""
    for part, joint in zip(row.tolist(), joints, strict=True):
        if abs(part) < _UNSPOKEN:
            continue
        size = f"{abs(part):.2g}"
        sign = "-" if part < 0 else "+" if words else ""
        words += f" {sign} " if words else sign
        words += f"c({names[joint]})" if size == "1" else f"{size} c({names[joint]})"
    return words
