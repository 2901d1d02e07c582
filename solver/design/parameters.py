"""Parameters of a plan: the joints to be determined, and what has to be known beside them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from jointstiff.solver.arrays import BoolArray, FloatArray, IndexArray
from jointstiff.solver.errors import RequestError

LEFT_OUT: Final = 0.01
"""Greatest share of the prior variance of what is to be predicted that left-out combinations of link
compliances have: readings in directions that a plan leaves out are noise to it."""
_NOT_EXCITED: Final = 1e-9
"""Root mean square of a joint's rows, relative to the greatest, below which nothing excites it."""


@dataclass(frozen=True, eq=False)
class Parameters:
    """Linear map from the columns of rows to the p parameters of a plan."""

    interest: int  #: s, the first parameters: relative compliances of the joints to be determined
    joints: IndexArray  #: (s,) these joints
    nominal: FloatArray  #: (n,) compliance that a relative one refers to [rad/(N·m)]
    #: (n,) whether the nominal compliance is known; otherwise each joint is taken to move the targets alike
    known: BoolArray
    basis: FloatArray  #: (P, p) columns of the parameters
    prior: FloatArray  #: (p, p) information known beforehand, in units of 1/variance of a parameter

    def rows(self, rows: FloatArray) -> FloatArray:
        """Return rows (..., P) of compliances as rows (..., p) of the parameters."""
        transformed: FloatArray = rows @ self.basis
        return transformed


def parameters_of(
    rows: FloatArray,
    predicted: FloatArray,
    names: Sequence[str],
    wanted: IndexArray | None,
    nominal: FloatArray,
    link_share: float | None,
) -> Parameters:
    """Choose the parameters of a plan.

    Link compliances, where the rows have their columns, are a nuisance. Before any reading they are taken
    to move the places by a share of what the joints do, each matrix entry alike; all of their combinations
    that move what is to be predicted are kept, but for a share of `LEFT_OUT` of the variance.

    Args:
        rows: (K, n) or (K, P) of candidates, whitened; the first n columns are the joints'.
        predicted: (L, n) or (L, P) of what is to be predicted; the same as `rows` without a work area.
        names: of the n joints.
        wanted: joints to be determined; all that the loads excite if None. Others that they excite are a
            nuisance.
        nominal: (n,) compliance [rad/(N·m)]; nan where it is not known.
        link_share: root mean square deflection by links, relative to that by joints; None where the nuisance
            is none of links, its columns in units of what is known of it.

    Raises:
        RequestError: no candidate excites a wanted joint.
    """
    n = len(names)
    size = np.sqrt(np.square(rows[:, :n]).mean(axis=0))
    excited = size > _NOT_EXCITED * size.max()
    chosen = np.flatnonzero(excited) if wanted is None and excited.any() else wanted
    chosen = np.arange(n) if chosen is None else chosen
    missing = chosen[~excited[chosen]]
    if len(missing):
        joints = ", ".join(names[j] for j in missing)
        raise RequestError(
            f"no candidate load twists {joints}, or no target moves when it turns",
            where="joints",
            remedy="allow loads in other directions, or name the joints to be determined, without these",
        )
    known = np.isfinite(nominal) & (np.nan_to_num(nominal) > 0.0)
    moved = size[known] * nominal[known]
    alike = float(np.median(moved)) if known.any() else 1.0
    unit = np.where(known, np.nan_to_num(nominal), alike / np.where(excited, size, 1.0))
    others = np.setdiff1d(np.flatnonzero(excited), chosen)
    columns = np.concatenate([chosen, others])
    basis = np.zeros((rows.shape[1], len(columns)))
    basis[columns, np.arange(len(columns))] = unit[columns]
    links = np.eye(rows.shape[1])[:, n:]
    if link_share is not None:
        links = _link_basis(predicted, n, unit * excited, link_share)
    basis = np.hstack([basis, links])
    prior = np.diag(np.r_[np.zeros(len(columns)), np.ones(links.shape[1])])
    return Parameters(len(chosen), chosen, unit, known, basis, prior)


def _link_basis(rows: FloatArray, n: int, unit: FloatArray, share: float) -> FloatArray:
    """Return the combinations of link compliances that rows see, scaled to unit prior (P, r)."""
    links = rows[:, n:]
    if not links.shape[1]:
        return np.zeros((rows.shape[1], 0))
    size = np.sqrt(np.square(links).mean(axis=0))
    seen = size > _NOT_EXCITED * size.max()
    by_joints = np.sqrt(np.square(rows[:, :n] * unit).sum(axis=1).mean())
    deviation = np.where(seen, share * by_joints / np.sqrt(seen.sum()) / np.where(seen, size, 1.0), 0.0)
    variances, directions = np.linalg.eigh((links.T @ links) * np.outer(deviation, deviation))
    kept = np.cumsum(np.maximum(variances, 0.0)) > LEFT_OUT * variances.sum()
    return np.vstack([np.zeros((n, int(kept.sum()))), deviation[:, None] * directions[:, kept]])
