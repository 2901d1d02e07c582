"""What the readings can say of each joint, and in words why they cannot (METHOD.md §6)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from solver.regressor import RegressorBlock

__all__ = ["Combination", "Exposure", "Identifiability", "Spectrum", "Visibility", "analyse"]

FloatArray = npt.NDArray[np.float64]
BoolArray = npt.NDArray[np.bool_]

NULL_COLUMN = 1e-9
"""A column this small beside what the joint's levers allow is rounding, not information."""
NULL_DIRECTION = 1e-7
"""Singular values of the equilibrated regressor below this, relative to the first, count as zero.

One threshold for all: rank, pseudo-inverse and fit. No reading is worth a digit in such a direction, and
the square of its inverse, which covariances hold, would drown in rounding.
"""
_PARTICIPATES = 1e-6


@dataclass(frozen=True, eq=False)
class Visibility:
    """Which joints leave a trace in the readings at all.

    Attributes:
        null: (n,) joints whose columns hold no information: exact zeros up to rounding.
        reference_compliance: (n,) compliance with which the joint alone, at its full lever, would
            explain all deflection [rad/(N·m)].
        reasons: (n,) for null joints why, with a remedy; None for the others.
    """

    null: BoolArray
    reference_compliance: FloatArray
    reasons: tuple[str | None, ...]


class Exposure:
    """How far the load reaches each joint and the targets see it, over a whole set.

    For each joint it compares what the load and targets did with what they could have done at the same
    levers, had the force pulled across them. These ratios need no unit and no frame.
    """

    def __init__(self, joint_names: tuple[str, ...]) -> None:
        n = len(joint_names)
        self._names = joint_names
        self._torque, self._lever, self._column, self._potential = np.zeros((4, n))
        self._motion = np.zeros(n)
        self._deflection = 0.0

    def add(self, block: RegressorBlock) -> None:
        """Take in a block of observations, as its targets see them."""
        self.add_seen_from(block, block.jacobian, block.measurements.present)

    def add_seen_from(self, block: RegressorBlock, jacobian: FloatArray, present: BoolArray) -> None:
        """Take in a block of observations, as other points see them.

        Args:
            block: B observations.
            jacobian: (B, T, 3, n) J_v at the points [m/rad].
            present: (B, T) which of them count.
        """
        part = block.measurements
        force = np.linalg.norm(part.force, axis=1)[:, None]
        moment = np.linalg.norm(part.moment, axis=1)[:, None]
        lever = np.sqrt(np.einsum("bij,bij->bj", block.load_jacobian, block.load_jacobian))
        motion = np.einsum("btij,btij,bt->bj", jacobian, jacobian, present.astype(float))
        reach = (lever * force + moment) ** 2
        self._torque += (block.torque**2).sum(axis=0)
        self._lever += reach.sum(axis=0)
        self._motion += motion.sum(axis=0)
        self._column += (block.torque**2 * motion).sum(axis=0)
        self._potential += (reach * motion).sum(axis=0)
        self._deflection += float((part.deflection**2).sum())

    @property
    def anything_moved(self) -> bool:
        """Whether any target moved."""
        return self._deflection > 0

    def visibility(self) -> Visibility:
        """Judge what has come in so far."""
        blind = self._potential <= NULL_COLUMN**2 * self._potential.max()
        null = blind | (self._column <= NULL_COLUMN**2 * self._potential)
        potential = np.where(self._potential > 0, self._potential, np.inf)
        return Visibility(
            null=null,
            reference_compliance=np.sqrt(self._deflection / potential),
            reasons=tuple(self._reason(j) if null[j] else None for j in range(len(null))),
        )

    def _reason(self, joint: int) -> str:
        name = self._names[joint]
        # A load on the joint's own axis has no lever: it is measured against the greatest one.
        lever = max(self._lever[joint], 1e-6 * self._lever.max())
        if self._torque[joint] <= NULL_COLUMN**2 * lever:
            return f"the load never twists {name}: add loads that twist it"
        return f"no target moves when {name} turns: place a target away from its axis"


@dataclass(frozen=True)
class Combination:
    """Joints whose compliances appear in the readings only together."""

    joints: tuple[int, ...]


@dataclass(frozen=True, eq=False)
class Identifiability:
    """Of the equilibrated, weighted regressor over the joints that the readings see.

    Attributes:
        parameters: number of joints.
        rank: number of directions determined.
        condition_number: ratio of the extreme singular values; inf if rank deficient.
        singular_values: largest first, dimensionless.
        combinations: groups that appear only together.
    """

    parameters: int
    rank: int
    condition_number: float
    singular_values: FloatArray
    combinations: tuple[Combination, ...]

    @property
    def combined(self) -> frozenset[int]:
        """The joints that appear only in combination."""
        return frozenset(joint for group in self.combinations for joint in group.joints)


class Spectrum:
    """Singular value decomposition of a weighted regressor, its columns brought to unit norm.

    One threshold decides the rank for all who ask: the verdicts, the fit and the covariance.

    Attributes:
        rank: number of singular values that count.
        singular_values: (p,) largest first.
        null_space: (p − rank, p) orthonormal directions that the readings do not see.
        determined: (m, p) the regressor without those directions, so that no fit follows rounding
            along them; the regressor itself where the rank is full.
        inverse: (p, m) pseudo-inverse of the regressor.
    """

    def __init__(self, R: FloatArray) -> None:
        """Decompose.

        Args:
            R: (m, p) weighted regressor, compressed, without null columns.
        """
        norms = np.linalg.norm(R, axis=0)
        scale = np.where(norms > 0, norms, 1.0)
        U, singular, Vt = np.linalg.svd(R / scale, full_matrices=R.shape[0] < R.shape[1])
        self.singular_values = np.zeros(R.shape[1])
        self.singular_values[: len(singular)] = singular
        self.rank = rank = int((self.singular_values > NULL_DIRECTION * singular[0]).sum())
        self.null_space: FloatArray = Vt[rank:]
        strong = U[:, :rank] * singular[:rank]
        self.determined: FloatArray = R if rank == R.shape[1] else strong @ Vt[:rank] * scale
        self.inverse: FloatArray = (Vt[:rank].T / singular[:rank]) @ U[:, :rank].T / scale[:, None]


def analyse(spectrum: Spectrum, columns: npt.NDArray[np.intp], parameters: int) -> Identifiability:
    """Say what a spectrum means for the joints.

    Args:
        spectrum: of the regressor of p joints.
        columns: (p,) the joint of each column.
        parameters: number of joints, null ones included.

    Returns:
        The analysis, with joints numbered as in `columns`.
    """
    singular = spectrum.singular_values
    full = spectrum.rank == len(columns)
    return Identifiability(
        parameters=parameters,
        rank=spectrum.rank,
        condition_number=float(singular[0] / singular[-1]) if full else float("inf"),
        singular_values=singular,
        combinations=tuple(
            Combination(tuple(int(columns[i]) for i in group)) for group in _groups(spectrum.null_space)
        ),
    )


def _groups(null_space: FloatArray) -> list[list[int]]:
    """Split the coordinates that take part in a null space (k, p) into independent groups.

    The projector onto the null space does not depend on its basis, and it is block diagonal over
    groups that do not mix.
    """
    if not len(null_space):
        return []
    linked = np.abs(null_space.T @ null_space) > _PARTICIPATES
    _, labels = connected_components(coo_array(linked), directed=False)
    involved = linked.diagonal()
    groups = [np.flatnonzero((labels == label) & involved) for label in np.unique(labels[involved])]
    return [group.tolist() for group in groups]
