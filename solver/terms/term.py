"""A term: something that can move a target, as columns by which its unknowns move it (method.md §13)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.readings.measurements import CommonUncertainty
from jointstiff.solver.terms.block import RegressorBlock
from jointstiff.solver.triangle import whitened


class Rows(NamedTuple):
    """Columns of terms, K together, then the readings; zero where nothing was read."""

    targets: FloatArray  #: (B, T, 3, K + 1) of the targets [m], axes of R0
    encoders: FloatArray | None  #: (B, n, K + 1) of the encoders [rad]; None without
    widths: dict[str, int]  #: number of columns of each term


class Motion(NamedTuple):
    """Motion by one unit of each of k unknowns."""

    targets: FloatArray  #: (B, T, 3, k) of the targets [m per unit], axes of R0
    joints: FloatArray | None = (
        None  #: (B, n, k) of the joints behind their encoders [rad per unit]; None for none
    )


@dataclass(frozen=True)
class Term:
    """Something that can move a target.

    What a fit assumes, what a test suspects, what a budget lists and what a plan hedges against are terms.
    """

    name: str  #: name in budgets, tests and plans
    unit: str  #: unit of its unknowns
    #: motion by its unknowns at a compliance (n,) of the joints [rad/(N·m)]
    motion: Callable[[RegressorBlock, FloatArray], Motion]
    #: standard uncertainties of its unknowns as the readings state them, repeated over them; none without
    prior: Callable[[CommonUncertainty], tuple[float, ...]] = lambda _: ()
    suspected: bool = False  #: whether it is tested as a cause of what the joints leave unexplained
    #: standard uncertainty of its unknowns as a nuisance of plans under one load; 0 leaves it out
    hedged: float = 0.0


def by_torque(block: RegressorBlock, compliance: FloatArray, torque: FloatArray) -> Motion:
    """Return what torques (B, n, k) about the joints move: ``J (c ∘ τ)`` and ``c ∘ τ``."""
    bent = compliance[:, None] * torque
    return Motion(block.jacobian @ bent[:, None], bent)


def rows_of(block: RegressorBlock, terms: Sequence[Term], compliance: FloatArray) -> Rows:
    """Return the columns of terms at a compliance (n,) of the joints, at which errors show [rad/(N·m)]."""
    part = block.measurements
    motions = {term.name: term.motion(block, compliance) for term in terms}
    targets = np.concatenate([*(m.targets for m in motions.values()), part.deflection[..., None]], axis=-1)
    if part.direction is not None:
        targets = part.shown(targets)
    if not part.present.all():
        targets[~part.present] = 0.0
    widths = {name: motion.targets.shape[-1] for name, motion in motions.items()}
    if part.encoders is None:
        return Rows(targets, None, widths)
    columns = [
        np.zeros((*part.joints.shape, widths[name])) if motion.joints is None else motion.joints
        for name, motion in motions.items()
    ]
    encoders = np.concatenate([*columns, part.encoders.deflection[..., None]], axis=-1)
    return Rows(targets, np.where(part.encoders.present[..., None], encoders, 0.0), widths)


def whitened_rows(block: RegressorBlock, terms: Sequence[Term], compliance: FloatArray) -> Rows:
    """Return `rows_of` in units of sigma: of unit covariance where the terms hold all that moves.

    An encoder's deflection has the variance 2 σ_e² (method.md §2).
    """
    rows, part = rows_of(block, terms, compliance), block.measurements
    encoders = None if rows.encoders is None else part.encoder_lever / np.sqrt(2.0) * rows.encoders
    return rows._replace(targets=whitened(part.covariance, rows.targets), encoders=encoders)
