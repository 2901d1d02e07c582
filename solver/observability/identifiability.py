"""Observability of each joint, reasons where it is missing, and the field's indices (method.md §6)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from jointstiff.solver.arrays import BoolArray, FloatArray, IndexArray
from jointstiff.solver.observability.combination import (
    Combination,
    WeakDirection,
    combinations,
    weak_direction,
)
from jointstiff.solver.regression.regressor import RegressorBlock

NULL_COLUMN = 1e-9
"""Norm of a column, relative to what the joint's levers allow, that counts as rounding."""
NULL_DIRECTION = 1e-7
"""Singular value of the equilibrated regressor, relative to the first, below which it counts as zero.

One threshold for rank, pseudo-inverse and fit: no reading determines a digit in such a direction, and
the square of its inverse, which covariances hold, would drown in rounding.
"""
HARD_TO_TELL = 100.0
"""Condition number above which results are unreliable (Schröer et al. 1992, as quoted by
Nahvi & Hollerbach 1996)."""


@dataclass(frozen=True, eq=False)
class Observability:
    """Joints that the readings depend on."""

    null: BoolArray  #: (n,) joints whose columns hold no information: exact zeros up to rounding
    #: (n,) compliance with which the joint alone, at its full lever, would explain all deflection
    #: [rad/(N·m)]
    reference_compliance: FloatArray
    reasons: tuple[str | None, ...]  #: (n,) for null joints why, with a remedy; None for the others
    #: (n,) norm of the joint's column over what it would be had the force pulled across the joint's lever
    #: and the moment turned about its axis in every observation; 0 to 1
    excitation: FloatArray
    greatest_torque: FloatArray  #: (n,) greatest torque of the load about the joint, over the set [N·m]


class Excitation:
    """Excitation of each joint by the load, and its visibility at the targets, over a whole set.

    For each joint it compares what the load and targets did with what they could have done at the same
    levers, had the force pulled across them. These ratios need no unit and no frame.
    """

    def __init__(self, joint_names: tuple[str, ...]) -> None:
        n = len(joint_names)
        self._names = joint_names
        self._torque, self._lever, self._column, self._potential = np.zeros((4, n))
        self._motion, self._greatest_torque = np.zeros((2, n))
        self._deflection = 0.0

    def add(self, block: RegressorBlock) -> None:
        """Take in a block of observations, as its targets see them."""
        self.add_seen_from(block, block.jacobian, block.measurements.present)

    def add_seen_from(self, block: RegressorBlock, jacobian: FloatArray, present: BoolArray) -> None:
        """Take in a block of observations, as other points and the joints' encoders see them.

        An encoder counts like a target on the lever on which both weigh the same.

        Args:
            block: B observations.
            jacobian: (B, T, 3, n) J_v at the points [m/rad].
            present: (B, T) which of them count.
        """
        part = block.measurements
        force = np.linalg.norm(part.force, axis=1)[:, None]
        moment = np.linalg.norm(part.moment, axis=1)[:, None]
        lever = np.sqrt(np.einsum("bij,bij->bj", block.load_jacobian, block.load_jacobian))
        seen = jacobian if present.all() else jacobian * present[..., None, None]
        seen = seen.reshape(len(seen), -1, seen.shape[-1])
        motion = np.einsum("bij,bij->bj", seen, seen)
        if part.encoders is not None:
            motion += part.encoder_lever**2 * part.encoders.present
            self._deflection += float((part.encoder_lever**2 * part.encoders.deflection**2).sum())
        reach = (lever * force + moment) ** 2
        self._torque += (block.torque**2).sum(axis=0)
        np.maximum(self._greatest_torque, np.abs(block.torque).max(axis=0), out=self._greatest_torque)
        self._lever += reach.sum(axis=0)
        self._motion += motion.sum(axis=0)
        self._column += (block.torque**2 * motion).sum(axis=0)
        self._potential += (reach * motion).sum(axis=0)
        self._deflection += float((part.deflection**2).sum())

    @property
    def anything_moved(self) -> bool:
        """Return whether any target moved."""
        return self._deflection > 0

    def observability(self) -> Observability:
        """Judge what has come in so far."""
        blind = self._potential <= NULL_COLUMN**2 * self._potential.max()
        null = blind | (self._column <= NULL_COLUMN**2 * self._potential)
        potential = np.where(self._potential > 0, self._potential, np.inf)
        return Observability(
            null=null,
            reference_compliance=np.sqrt(self._deflection / potential),
            reasons=tuple(self._reason(j) if null[j] else None for j in range(len(null))),
            excitation=np.sqrt(self._column / potential),
            greatest_torque=self._greatest_torque,
        )

    def _reason(self, joint: int) -> str:
        name = self._names[joint]
        # A load on the joint's own axis has no lever: it is measured against the greatest one.
        lever = max(self._lever[joint], 1e-6 * self._lever.max())
        if self._torque[joint] <= NULL_COLUMN**2 * lever:
            return f"the load never twists {name}: add loads that twist it"
        return f"no target moves when {name} turns: place a target away from its axis"


@dataclass(frozen=True, eq=False)
class Identifiability:
    """Observability analysis of the equilibrated, weighted regressor over the observable joints."""

    parameters: int  #: number of joints
    rank: int  #: number of directions determined
    condition_number: float  #: ratio of the extreme singular values; inf if rank deficient
    singular_values: FloatArray  #: largest first, dimensionless
    combinations: tuple[Combination, ...]  #: groups that appear only together
    #: least observable direction; None if the rank is not full, or every direction is well observable
    weakest: WeakDirection | None

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
        scale: (p,) norms of the columns, 1 where a norm is zero.
        weakest: (p,) unit vector of the least singular value, columns of unit norm.
        null_space: (p − rank, p) orthonormal directions that the readings do not see.
        determined: (m, p) the regressor without those directions, so that no fit follows rounding
            along them; the regressor itself where the rank is full.
        inverse: (p, m) pseudo-inverse of the regressor.
        seen: (rank, p) functions of the compliances that the readings determine, one a row.
    """

    def __init__(self, R: FloatArray) -> None:
        """Decompose.

        Args:
            R: (m, p) weighted regressor, compressed; p may be zero.
        """
        norms = np.linalg.norm(R, axis=0)
        self.scale: FloatArray = np.where(norms > 0, norms, 1.0)
        scale = self.scale
        U, singular, Vt = np.linalg.svd(R / scale, full_matrices=R.shape[0] < R.shape[1])
        self.singular_values = np.zeros(R.shape[1])
        self.singular_values[: len(singular)] = singular
        largest = singular.max(initial=0.0)
        self.rank = rank = int((self.singular_values > NULL_DIRECTION * largest).sum())
        self.weakest: FloatArray = Vt[-1] if len(Vt) else np.zeros(0)
        self.null_space: FloatArray = Vt[rank:]
        strong = U[:, :rank] * singular[:rank]
        self.determined: FloatArray = R if rank == R.shape[1] else strong @ Vt[:rank] * scale
        self.seen: FloatArray = Vt[:rank] * scale
        self.inverse: FloatArray = (Vt[:rank].T / singular[:rank]) @ U[:, :rank].T / scale[:, None]


def analyse(spectrum: Spectrum, columns: IndexArray, parameters: int) -> Identifiability:
    """Return the observability of the joints from a spectrum.

    Args:
        spectrum: of the regressor of p joints.
        columns: (p,) the joint of each column.
        parameters: number of joints, null ones included.

    Returns:
        The analysis, with joints numbered as in `columns`.
    """
    singular = spectrum.singular_values
    full = spectrum.rank == len(columns)
    condition = float(singular[0] / singular[-1]) if full else float("inf")
    return Identifiability(
        parameters=parameters,
        rank=spectrum.rank,
        condition_number=condition,
        singular_values=singular,
        combinations=combinations(spectrum.null_space, spectrum.scale, columns),
        weakest=weak_direction(spectrum.weakest, spectrum.scale, columns, condition)
        if full and condition > HARD_TO_TELL
        else None,
    )


def noise_reason(joint: int, names: tuple[str, ...], observability: Observability, uncertainty: float) -> str:
    """Return why noise hides a joint that the readings depend on.

    Args:
        joint: its index.
        names: of the n joints.
        observability: of the same observations.
        uncertainty: standard uncertainty of its compliance [rad/(N·m)].
    """
    torque, most = observability.greatest_torque, int(np.argmax(observability.greatest_torque))
    beside = "" if most == joint else f", and {names[most]} with up to {torque[most]:.2g} N.m"
    return (
        f"{names[joint]} is hidden by noise: its standard uncertainty of {uncertainty:.2g} "
        f"rad/(N.m) exceeds {observability.reference_compliance[joint]:.2g} rad/(N.m), the "
        "compliance with which it alone would explain all deflections; the load twists it with at "
        f"most {torque[joint]:.2g} N.m{beside}: add loads that twist it more"
    )


@dataclass(frozen=True)
class ObservabilityIndices:
    """Observability indices of a set of postures and loads; larger is better.

    Of the singular values ``s_1 ≥ … ≥ s_p`` of the regressor, each of its p columns divided by the norm
    that it would have had if, in every observation, the force had pulled across the joint's lever
    and the moment had turned about its axis. As ``Σ s² ≤ p``, no index exceeds 1.
    """

    o1: float  #: ``(s_1 ⋯ s_p)^(1/p)``, Borm & Menq 1991
    o2: float  #: ``s_p / s_1``, Driels & Pathre 1990
    o3: float  #: ``s_p``, Nahvi, Hollerbach & Hayward 1994
    o4: float  #: ``s_p² / s_1``, Nahvi & Hollerbach 1996
    o5: float  #: ``1 / (1/s_1 + … + 1/s_p)``, Sun & Hollerbach 2008

    @classmethod
    def of(cls, singular_values: FloatArray) -> ObservabilityIndices:
        """The indices of positive singular values (p,), largest first."""
        s = singular_values
        return cls(
            o1=float(np.exp(np.log(s).mean())),
            o2=float(s[-1] / s[0]),
            o3=float(s[-1]),
            o4=float(s[-1] ** 2 / s[0]),
            o5=float(1.0 / np.sum(1.0 / s)),
        )


def observability_indices(regressor: FloatArray, observability: Observability) -> ObservabilityIndices | None:
    """IndexArray over the joints that the readings see.

    Borm & Menq divide by the root of the number of readings; here the norms that divide the columns grow
    with it, so that readings taken twice change nothing.

    Args:
        regressor: (m, n) of all readings, weighted by their covariance, in any unit.
        observability: of the same readings.

    Returns:
        The indices; None where the rank is not full.
    """
    visible = ~observability.null
    spectrum = Spectrum(regressor[:, visible])
    if spectrum.rank < np.count_nonzero(visible):
        return None
    columns = regressor[:, visible] / spectrum.scale * observability.excitation[visible]
    singular_values: FloatArray = np.linalg.svd(columns, compute_uv=False).astype(np.float64, copy=False)
    return ObservabilityIndices.of(singular_values)
