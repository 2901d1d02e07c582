"""Comparison of the targets' positions after the load was removed with those before (method.md §3).

A spring comes back; friction, slip and a set do not. The positions after the load are compared with those
before: ``r = κ A c + ε``, with the deflections A c that the model predicts. κ is the share that remains. Its
uncertainty comes from the spread over the postures, because all targets of a posture return alike (Liang &
Zeger, *Biometrika* 73, 1986).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
from scipy import special

from jointstiff.solver.arrays import BoolArray, FloatArray
from jointstiff.solver.fit.rows import Rows

_LEVEL: Final = 1e-3
"""p-value below which a share that remains is no chance."""
_MATTERS: Final = 0.02
"""Share of the deflections that remains and changes a stiffness by one percent."""
_LEAST_POSTURES: Final = 3
_SCALE: Final = float(np.sqrt(4.0 / 3.0))
"""Noise of a difference of two positions over that of a deflection from the mean of two positions."""


@dataclass(frozen=True)
class Unloading:
    """Comparison of the positions after the load with those before the load."""

    postures: int  #: number of postures that were read again
    distance: float  #: root mean square distance of a target from its first position [m]
    share: float | None  #: share κ of the deflections that remains; None for fewer than three postures
    standard_uncertainty: float | None  #: of the share; None where the share is None
    p_value: float  #: of the test that nothing remains; 1 without a share

    @property
    def remains(self) -> bool:
        """True if a part of the deflections remains, so large that it changes the stiffnesses."""
        return self.share is not None and abs(self.share) > _MATTERS and self.p_value < _LEVEL


def compare_unloaded_positions(rows: Rows, compliance: FloatArray) -> Unloading | None:
    """Compare the positions after the load with those before the load.

    Args:
        rows: N observations.
        compliance: (n,) fitted joint compliances [rad/(N·m)].

    Returns:
        None if no target was read again.
    """
    returned = rows.measurements.returned
    if returned is None or not returned.present.any():
        return None
    read_again = np.flatnonzero(returned.present.any(axis=1))
    remaining, present = returned.remaining[read_again], returned.present[read_again]
    distance = float(np.sqrt(np.square(remaining[present]).sum(axis=-1).mean()))
    count = len(read_again)
    sums = _sum_by_posture(rows.at(None)[read_again], compliance, remaining, present)
    if count < _LEAST_POSTURES or not sums.squares.sum() > 0.0:
        return Unloading(count, distance, share=None, standard_uncertainty=None, p_value=1.0)
    share, uncertainty = sums.share, sums.standard_uncertainty
    student_t = abs(share) / uncertainty if uncertainty > 0.0 else np.inf
    p_value = float(2.0 * special.stdtr(count - 1, -student_t))
    return Unloading(count, distance, _SCALE * share, _SCALE * uncertainty, p_value)


class _PostureSums(NamedTuple):
    """Sums over the targets of each of P postures, of remaining displacements r and predicted deflections m.

    Both are whitened, and r is divided by `_SCALE`, so that their noise has the variance sigma².
    """

    products: FloatArray  # (P,) Σ rᵀ m
    squares: FloatArray  # (P,) Σ mᵀ m

    @property
    def share(self) -> float:
        """Share κ of the deflections that remains: the regression ``κ = Σ rᵀm / Σ mᵀm`` of r on m."""
        return float(self.products.sum() / self.squares.sum())

    @property
    def standard_uncertainty(self) -> float:
        """Standard uncertainty of the share, from the deviations of the postures from the common share."""
        count = len(self.products)
        deviations = self.products - self.share * self.squares
        corrected = np.square(deviations).sum() * count / (count - 1.0)
        return float(np.sqrt(corrected) / self.squares.sum())


def _sum_by_posture(
    rows: Rows, compliance: FloatArray, remaining: FloatArray, present: BoolArray
) -> _PostureSums:
    """Sum products of remaining displacements and predicted deflections over the targets of each posture.

    Args:
        rows: P observations whose targets were read again after the load.
        compliance: (n,) fitted joint compliances [rad/(N·m)].
        remaining: (P, T, 3) positions after the load less those before, axes of R0 [m].
        present: (P, T) which targets were read again.
    """
    products, squares = [], []
    start = 0
    for block in rows.generate_blocks():
        stop = start + len(block.torque)
        predicted = block.A @ compliance  # (B, T, 3) deflections [m]
        both = np.stack([predicted, remaining[start:stop] / _SCALE], axis=-1)
        both[~present[start:stop]] = 0.0
        whitened = block.whiten(both)
        m, r = whitened[..., 0], whitened[..., 1]
        products.append((m * r).sum(axis=(1, 2)))
        squares.append(np.square(m).sum(axis=(1, 2)))
        start = stop
    return _PostureSums(np.concatenate(products), np.concatenate(squares))
