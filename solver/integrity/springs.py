"""The deflections as any springs in the joints would make them: a robust fit without bounds."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from solver.configuration import Configurations
from solver.measurements import Measurements
from solver.regressor import joint_torque

__all__ = ["Springs", "fit_springs"]

FloatArray = npt.NDArray[np.float64]

_ROUNDS: Final = 12
_NULL: Final = 1e-9
"""Norm of a column beside the greatest, of a joint that no load twists."""
_RANK: Final = 1e-10
"""Of the Gram matrix of unit columns: combinations below it stay at zero."""
_SAMPLE: Final = 2000
"""Observations that fix a handful of compliances well enough to judge all by them."""


@dataclass(frozen=True, eq=False)
class Springs:
    """A fit of N observations of T targets.

    Attributes:
        predicted: (N, T, 3) deflections [m]; zero where not read.
        residual: (N, T, 3) measured less predicted [m].
        work: of the load, as predicted, summed over the observations [J]; springs make it positive.
        parameters: joints that were fitted.
        unexplained: median residual of an observation over its median deflection.
    """

    predicted: FloatArray
    residual: FloatArray
    work: float
    parameters: int
    unexplained: float


def fit_springs(configurations: Configurations, measurements: Measurements) -> Springs:
    """Fit compliances of either sign, by sums of distances rather than of squares: few mistakes move it little.

    Args:
        configurations: of the N observations.
        measurements: their loads and deflections.
    """
    A, torque = _regressor(configurations, measurements)
    d = measurements.deflection
    step = max(1, -(-len(d) // _SAMPLE))
    compliance = _least_distances(
        A[::step].reshape(len(A[::step]), -1, A.shape[-1]), d[::step].reshape(len(d[::step]), -1)
    )
    predicted = A @ compliance
    residual = d - predicted
    sizes = [float(np.median(np.linalg.norm(x.reshape(len(x), -1), axis=1))) for x in (residual, d)]
    return Springs(
        predicted=predicted,
        residual=residual,
        work=float((torque**2).sum(axis=0) @ compliance),
        parameters=int(np.count_nonzero(compliance)),
        unexplained=sizes[0] / sizes[1] if sizes[1] else 0.0,
    )


def _regressor(at: Configurations, m: Measurements) -> tuple[FloatArray, FloatArray]:
    """A (N, T, 3, n) and the torques (N, n), as METHOD.md §2."""
    load = at.jacobian_at(at.to_base(m.load_point[:, None]))[:, 0]
    torque = joint_torque(at, load, m.force, m.moment)
    points = m.position
    if m.in_flange.any():
        points = np.where(m.in_flange[..., None], at.to_base(points), points)
    A: FloatArray = at.jacobian_at(points) * torque[:, None, None]
    return A * m.present[..., None, None], torque


def _least_distances(A: FloatArray, d: FloatArray) -> FloatArray:
    """Compliances (n,) that minimise the sum of the observations' distances ‖d_i − A_i c‖, by reweighting."""
    norms = np.sqrt((A**2).sum(axis=(0, 1)))
    visible = np.flatnonzero(norms > _NULL * norms.max()) if norms.max() > 0.0 else np.empty(0, np.intp)
    compliance = np.zeros(A.shape[-1])
    if not len(visible):
        return compliance
    scaled = A[..., visible] / norms[visible]
    gram, moment = scaled.transpose(0, 2, 1) @ scaled, np.einsum("kij,ki->kj", scaled, d)
    weight = np.ones(len(d))
    for _ in range(_ROUNDS):
        G = np.einsum("k,kij->ij", weight, gram) / weight.sum()
        x = np.linalg.pinv(G, rcond=_RANK, hermitian=True) @ (weight @ moment / weight.sum())
        distance = np.linalg.norm(d - scaled @ x, axis=1)
        weight = 1.0 / np.maximum(distance, max(1e-3 * float(np.median(distance)), 1e-12))
    compliance[visible] = x / norms[visible]
    return compliance
