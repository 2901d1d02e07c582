"""Comparison of the targets' positions after the load was removed with those before (method.md §3).

A spring comes back; friction, slip and a set do not. The positions after the load are compared with those
before: ``r = κ A c + ε``, with the deflections A c that the model predicts. κ is the share that remains. Its
uncertainty comes from the spread over the postures, because all targets of a posture return alike (Liang &
Zeger, *Biometrika* 73, 1986).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy import special

from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.fit.rows import Rows

_LEVEL: Final = 1e-3
"""p-value below which a share that remains is no chance."""
_MATTERS: Final = 0.02
"""Share of the deflections that remains and changes a stiffness by one percent."""
_LEAST_POSTURES: Final = 3
_VARIANCE: Final = 4.0 / 3.0
"""Variance of a difference of two positions over that of a deflection from the mean of two positions."""


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

    The share κ of the deflections that remains is a regression of the remaining displacements r on the
    predicted deflections m, ``κ = Σ rᵀm / Σ mᵀm``, both whitened (uncorrelated noise of variance sigma²).

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
    part = rows.at(None)[read_again]
    remaining, present = returned.remaining[read_again], returned.present[read_again]
    products, squares = [], []  # of each posture: rᵀ m and mᵀ m
    start = 0
    for block in part.generate_blocks():
        stop = start + len(block.torque)
        predicted = block.A @ compliance  # (B, T, 3) deflections [m]
        remaining_scaled = remaining[start:stop] / np.sqrt(_VARIANCE)  # with the variance of a deflection
        both = np.stack([predicted, remaining_scaled], axis=-1)
        both[~present[start:stop]] = 0.0
        whitened = block.whiten(both)
        m, r = whitened[..., 0], whitened[..., 1]
        products.append((m * r).sum(axis=(1, 2)))
        squares.append(np.square(m).sum(axis=(1, 2)))
        start = stop
    product, square = np.concatenate(products), np.concatenate(squares)
    distance = float(np.sqrt(np.square(remaining[present]).sum(axis=-1).mean()))
    count = len(read_again)
    if count < _LEAST_POSTURES or not square.sum() > 0.0:
        return Unloading(count, distance, share=None, standard_uncertainty=None, p_value=1.0)
    share = float(product.sum() / square.sum())
    deviation = product - share * square  # of each posture from the common share
    uncertainty = float(np.sqrt(np.square(deviation).sum() * count / (count - 1.0)) / square.sum())
    student_t = abs(share) / uncertainty if uncertainty > 0.0 else np.inf
    p_value = float(2.0 * special.stdtr(count - 1, -student_t))
    scale = float(np.sqrt(_VARIANCE))  # undoes the division of r
    return Unloading(count, distance, scale * share, scale * uncertainty, p_value)
