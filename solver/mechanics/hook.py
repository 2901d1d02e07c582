"""Load point as a reading: a target at the hook that was read without load, located in the flange frame."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from jointstiff.solver.arrays import BoolArray, FloatArray
from jointstiff.solver.mechanics.postures import Postures

LEAST_SPREAD: Final = 0.03
"""Least spread of targets across their longest direction [m] that shows how the flange is turned."""


@dataclass(frozen=True, eq=False)
class HookReading:
    """Load point that readings of a target at the hook show, and the load point that was stated, too."""

    target: str  #: name of the target at the hook
    place: FloatArray  #: (3,) load point that the readings show, flange frame [m]
    uncertainty: float  #: standard uncertainty of each coordinate of `place` [m]
    stated: FloatArray | None  #: (3,) load point that was stated, flange frame [m]; None if not stated
    stated_uncertainty: float  #: standard uncertainty of each coordinate of `stated` [m]

    @property
    def distance(self) -> float:
        """Distance between the stated load point and the one that the readings show [m]; 0 if not stated."""
        return 0.0 if self.stated is None else float(np.linalg.norm(self.stated - self.place))

    def find_largest_distance(self, quantile: float) -> float:
        """Return the largest distance [m] at which the two load points agree.

        `quantile` is that of chi-square with 3 degrees of freedom: ``|x₁ − x₂|² ≤ quantile (u₁² + u₂²)``.
        """
        return float(np.sqrt(quantile * (self.uncertainty**2 + self.stated_uncertainty**2)))


@dataclass(frozen=True, eq=False)
class HookShot:
    """One reading of the target at the hook, placed by the other targets of its posture."""

    place: FloatArray  #: (3,) load point that the reading shows, flange frame [m]
    targets: int  #: number of other targets that were read in this posture and in others
    shift: float  #: distance by which the posture's model places these targets wrong, on average [m]
    misfit: float  #: greatest distance of one of these targets from its mean place after the correction [m]


def locate_hook(
    postures: Postures, targets: FloatArray, was_read: BoolArray, hook: FloatArray, is_shot: BoolArray
) -> list[HookShot]:
    """Return the places in the flange frame of a target at the hook, one for each of S shots.

    The model's kinematics are wrong by up to millimetres in a single posture. Therefore the hook is placed
    relative to the targets that were read in the same posture: the rigid motion that brings these targets to
    their mean places in the other postures also corrects the hook. Fewer than three targets, or targets in a
    line, correct the translation only.

    Args:
        postures: kinematics of N unloaded postures.
        targets: (N, T, 3) unloaded positions of the other targets, in R0 [m].
        was_read: (N, T) mask of the targets whose positions were read.
        hook: (N, 3) positions of the target at the hook, in R0 [m].
        is_shot: (N,) mask of the S observations in which the target at the hook was read.
    """
    in_flange = postures.to_flange(targets)
    hook_in_flange = postures.to_flange(hook[:, None])[:, 0]
    counts = was_read.sum(axis=0)  # (T,)
    sums = np.where(was_read[..., None], in_flange, 0.0).sum(axis=0)  # (T, 3)
    shots = list[HookShot]()
    for i in np.flatnonzero(is_shot):
        is_known = was_read[i] & (counts > 1)  # also read in another posture
        here = in_flange[i, is_known]
        elsewhere = (sums[is_known] - here) / (counts[is_known, None] - 1)
        shots.append(_place_by_means(hook_in_flange[i], here, elsewhere))
    return shots


def _place_by_means(hook: FloatArray, targets: FloatArray, means: FloatArray) -> HookShot:
    """Move the hook (3,) by the rigid motion that brings targets (K, 3) to their mean places (K, 3)."""
    if not len(targets):
        return HookShot(hook, targets=0, shift=0.0, misfit=0.0)
    centre, mean_centre = targets.mean(axis=0), means.mean(axis=0)
    U, spread, V = np.linalg.svd((means - mean_centre).T @ (targets - centre))
    rotation = np.eye(3)
    if spread[1] > LEAST_SPREAD**2:
        is_reflected = np.linalg.det(U @ V) < 0.0
        rotation = U @ np.diag([1.0, 1.0, -1.0 if is_reflected else 1.0]) @ V
    corrected = mean_centre + (targets - centre) @ rotation.T
    return HookShot(
        place=np.asarray(mean_centre + rotation @ (hook - centre)),
        targets=len(targets),
        shift=float(np.linalg.norm(mean_centre - centre)),
        misfit=float(np.linalg.norm(corrected - means, axis=1).max()),
    )
