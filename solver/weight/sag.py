"""Own weight as a fit found it: products of compliances and weights, with what is known of their errors.

Positions tell products of a compliance and a weight far better than either, so that the sag has a narrower
interval than the compliances. About the optimum the readings are linear in x, ``A x = b + ε``. A parameter
is off by its bound's half-width in standard uncertainties, unless the readings tell it better: with D that
of all of them, ``cov x = (AᵀA/σ² + D⁻²)⁻¹``, widened for joints whose own interval, an outer bound, is wider.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.predict.models import IdentifiedWeight
from jointstiff.solver.weight.bodies import Burden
from jointstiff.solver.weight.fit import WeightFit, joint_unknowns

_LEAST_SIGMA: Final = 1e-15
"""Rounding: no reading is better."""


def identified_weight(
    burden: Burden, fit: WeightFit, sigma: float, uncertainty: FloatArray
) -> IdentifiedWeight | None:
    """Return the weights that the sag of a fit is due to; None where springs balance some of them.

    Args:
        burden: bodies that hang on in all observations.
        fit: of the robot and its weight.
        sigma: of a residual, in the fit's unit.
        uncertainty: (n,) of the compliances; zero where there is none.
    """
    if burden.balancers:
        return None
    problem, x, n = fit.reduced, fit.optimum.x, len(fit.compliance)
    size = len(x)
    # Covariance of x, by one QR: the bounds of a compliance are its cap, of its products itself
    reach = np.full(size, 1e-3 * float(np.abs(x).max()))
    blocks = list(zip(problem.cones.first.tolist(), problem.cones.blocks, strict=True))
    for (start, block), cap in zip(blocks, problem.cones.cap.tolist(), strict=True):
        reach[start : start + block.size] = np.maximum(reach[start], x[start])
        reach[start] = cap
    stacked = np.vstack([problem.A / max(sigma, _LEAST_SIGMA), np.diag(1.0 / reach)])
    root = np.linalg.inv(np.linalg.qr(stacked, mode="r"))
    nominal, unit = np.zeros((n, 4)), np.zeros((n, 4, len(burden.unknown[0])))
    for body in burden.bodies:
        nominal[body.joint] += 0.5 * (body.most + body.least) * np.array([1.0, *body.centre])
    for k, (number, inertia) in enumerate(burden.unknown[0]):
        unit[burden.bodies[number].joint, :, k] = inertia
    units = unit.reshape(4 * n, -1)
    inertias, roots = np.tile(nominal, (n, 1, 1)), np.zeros((n * n * 4, size))
    compliances = np.zeros((n, size))
    for j, scale, (start, block) in zip(problem.seen.tolist(), problem.unit.tolist(), blocks, strict=True):
        scaled = joint_unknowns(fit.rows, j, burden, units)[1][:, : block.size - 1]
        products = scale * np.column_stack([nominal.ravel(), scaled])
        part = slice(start, start + block.size)
        own = scale * float(np.linalg.norm(root[start]))
        root[part] *= max(1.0, uncertainty[j] / own)
        roots[4 * n * j : 4 * n * (j + 1)] = products @ root[part]
        compliances[j] = scale * root[start]
        if x[start] > 0.0:
            inertias[j] = (products @ x[part] / (scale * x[start])).reshape(n, 4)
    mass: FloatArray = inertias[..., 0]
    centre = inertias[..., 1:] / np.where(mass > 0.0, mass, 1.0)[..., None]
    return IdentifiedWeight(mass, centre, fit.gravity, root=np.vstack([compliances, roots]))
