"""Deflection and rotation under given loads, with intervals that say what they hold (method.md §9)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from jointstiff.solver.arrays import BoolArray, FloatArray
from jointstiff.solver.deflection.cartesian import CartesianCompliance
from jointstiff.solver.deflection.joint_model import JointModel
from jointstiff.solver.deflection.load_cases import LoadCases
from jointstiff.solver.deflection.loaded import LoadedPosture
from jointstiff.solver.deflection.own_weight import OwnWeight


@dataclass(frozen=True, eq=False)
class Deflection:
    """Deflections of B load cases, axes of R0."""

    displacement: FloatArray  #: (B, 3) of the places [m]
    rotation: FloatArray  #: (B, 3) rotation vectors of the flange [rad]
    #: (B, 6, 2) of displacement, then rotation, from the readings alone, under the constraints; None where
    #: no uncertainty is known
    interval: FloatArray | None
    #: (B, 6, 6) from the readings alone, without constraints; None where unknown
    covariance: FloatArray | None
    #: (B, n) joints that the load twists and of which the readings say nothing: where there is one, no
    #: number holds
    unseen: BoolArray
    compliance: CartesianCompliance  #: Cartesian compliance at the places, in the loaded postures
    posture: LoadedPosture  #: the loaded postures


def predict_deflections(
    model: JointModel, cases: LoadCases, *, confidence: float, weight: OwnWeight | None = None
) -> Deflection:
    """Predict how far the tool bends.

    The balance of springs and load is exact; its derivative with respect to the compliances,
    ``J_x (I − diag(c)(K_c + ∂g/∂q))⁻¹ diag(τ)``, carries their errors.

    Args:
        model: elastic joints.
        cases: B load cases.
        confidence: level of the intervals.
        weight: of the links; None leaves it out.

    Raises:
        RequestError: a load finds no stable balance.
    """
    posture = LoadedPosture.of(model.robot, model.compliance, cases, weight)
    rows = compliance_rows(posture)
    value = np.concatenate([posture.displacement, posture.rotation], axis=1)
    ends = model.ends(rows.reshape(-1, model.robot.n), confidence)
    interval = None
    if ends is not None:  # aᵀc is linear, the balance is not: shift the ends to where the value is
        linear = rows @ model.compliance
        interval = ends.reshape(*value.shape, 2) + (value - linear)[..., None]
    known = model.likelihood is not None
    return Deflection(
        displacement=value[:, :3],
        rotation=value[:, 3:],
        interval=interval,
        covariance=rows @ model.covariance @ rows.transpose(0, 2, 1) if known else None,
        unseen=model.unseen(rows),
        compliance=CartesianCompliance.of(model, posture),
        posture=posture,
    )


def compliance_rows(posture: LoadedPosture) -> FloatArray:
    """Return ``∂(displacement, rotation)/∂c`` (B, 6, n) at the places [m, then rad, / (rad/(N·m))]."""
    jacobian = posture.jacobian(posture.cases.place)
    rows: FloatArray = jacobian @ (posture.softened * posture.torque[:, None])
    return rows
