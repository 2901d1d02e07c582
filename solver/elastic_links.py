"""Elastic links: joint and link compliances of a whole set, with what they explain and how that is known."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np
import numpy.typing as npt

from solver.cone import raised
from solver.cross_validation import Folds, joints_only
from solver.elastic_model import ElasticModel, Formulation, formulate
from solver.exceptions import UnsupportedMethodError
from solver.face import effective_freedom
from solver.link_regressor import ElasticColumns, ElasticRows, elastic_blocks
from solver.measurements import Measurements
from solver.prediction import Prediction
from solver.robot import Robot
from solver.semidefinite import ConeCertificate, certify_cone, solve_cone
from solver.settings import Settings
from solver.symmetric import entries, to_matrix, to_vector

__all__ = [
    "CERTIFIED_GAP",
    "ElasticEstimate",
    "Element",
    "LinkCertificate",
    "LinkCompliance",
    "estimate_elastic",
    "refuse_unsupported_elastic",
]

FloatArray = npt.NDArray[np.float64]
Indices = npt.NDArray[np.intp]

CERTIFIED_GAP: Final = 1e-2
"""Of a certificate that is accepted, in units of sigma."""
_LEAST_FREEDOM: Final = 0.5
"""Degrees of freedom below which the residuals say nothing of sigma."""


@dataclass(frozen=True)
class LinkCertificate:
    """Evidence of optimality, from the data.

    Attributes:
        least_eigenvalue: of the matrices as they are returned, each in SI units; zero or positive.
        dual: how far the slack matrices are from positive semidefinite, over the weight of the penalty.
        gap: bound of the distance, over all weighted readings, between what is fitted and what the optimum
            fits, in units of `scale`.
        scale: sigma where it is given, else the residual scale of joints alone [m].
        tolerance: of Clarabel, that sufficed.
    """

    least_eigenvalue: float
    dual: float
    gap: float
    scale: float
    tolerance: float


@dataclass(frozen=True, eq=False)
class LinkCompliance:
    """The compliance of a link, in the frame of the joint that carries it.

    Attributes:
        joint: index of that joint.
        matrix: (6, 6) displacement (m, then rad) by the load's wrench (N, then N·m), about the origin of
            the joint's frame and in its axes.
        translation: principal compliances (3,) [m/N], largest first, and their directions (3, 3) in columns.
        rotation: the same of rotations [rad/(N·m)].
        effective_freedom: how many of its numbers the readings determine.
        parameters: how many numbers it has.
    """

    joint: int
    matrix: FloatArray
    translation: tuple[FloatArray, FloatArray]
    rotation: tuple[FloatArray, FloatArray]
    effective_freedom: float
    parameters: int


@dataclass(frozen=True, eq=False)
class Element:
    """What an element contributes to the deflection.

    Attributes:
        kind: a joint, the coupling between joints, or a link.
        joint: index of the joint, or of the one that carries the link; None for the coupling.
        share: of the measured deflection, ``Σ δp_e·δp / Σ ‖δp‖²`` over the set.
        by_observation: (N,) the same of each observation; zero where nothing moved.
    """

    kind: Literal["joint", "coupling", "link"]
    joint: int | None
    share: float
    by_observation: FloatArray


@dataclass(frozen=True, eq=False)
class ElasticEstimate:
    """Joint and link compliances with their evidence.

    Attributes:
        model: what bends.
        weight: λ of the penalty.
        compliance: (n,) of the joints [rad/(N·m)]; NaN where the readings do not see one.
        coupled: (n, n) full joint compliance [rad/(N·m)]; None where joints are not coupled. Its rows of
            joints that are not seen are zero.
        links: that bend.
        elements: what each explains.
        prediction: of all deflections.
        sigma: given, or of the residuals [m]; None without degrees of freedom.
        chi_square: of the weighted residuals, under sigma.
        degrees_of_freedom: readings less effective freedom.
        effective_freedom: of the whole model: how many numbers the readings determine.
        parameters: how many numbers the model has.
        certificate: of optimality.
    """

    model: ElasticModel
    weight: float
    compliance: FloatArray
    coupled: FloatArray | None
    links: tuple[LinkCompliance, ...]
    elements: tuple[Element, ...]
    prediction: Prediction
    sigma: float | None
    chi_square: float
    degrees_of_freedom: float
    effective_freedom: float
    parameters: int
    certificate: LinkCertificate


def refuse_unsupported_elastic(measurements: Measurements, settings: Settings) -> None:
    """Refuse what does not go with more than joints, before any work is done.

    Raises:
        UnsupportedMethodError: naming the option and what to do.
    """
    positive = bool((settings.bounds.lower == 0.0).all() and np.isinf(settings.bounds.upper).all())
    refused = (
        (settings.method != "partial_pose", "method", "use method partial_pose"),
        (settings.weighting != "covariance", "weighting", "use weighting covariance"),
        (settings.loss != "squared", "loss", "use loss squared without the suspicious readings"),
        (not positive, "stiffness_bounds", "leave bounds out, and compliances positive"),
        (bool(settings.order), "stiffness_order", "leave the order of the joints out"),
        (settings.prior is not None, "priors", "leave the priors out"),
        (settings.complementary_stiffness, "complementary_stiffness", "neglect the complementary stiffness"),
        (measurements.encoders is not None, "encoder_readings", "leave the encoder readings out"),
    )
    for is_refused, where, remedy in refused:
        if is_refused:
            raise UnsupportedMethodError(
                f"elasticity beyond joints does not go with this {where.replace('_', ' ')}",
                where=where,
                remedy=f"{remedy}, or use elasticity joints",
            )


def estimate_elastic(
    robot: Robot, measurements: Measurements, folds: Folds, model: ElasticModel, weight: float
) -> ElasticEstimate:
    """Fit a model to a whole set.

    Args:
        robot: n joints.
        measurements: N observations.
        folds: of the same, for its compressed rows.
        model: what bends besides the joints.
        weight: λ > 0 of the penalty.

    Raises:
        UnsupportedMethodError: the penalty has no scale.
        SolverError: optimality could not be certified.
    """
    rows = folds.all_rows
    formulation = formulate(rows, model, folds.visible)
    scale = measurements.sigma or _residual_scale(formulation, rows)
    program = formulation.program(weight)
    gap = CERTIFIED_GAP * scale / formulation.size
    x = solve_cone(program, gap=0.5 * gap).x
    compliances, least = _returned(formulation.compliances(x), model)
    x = compliances[formulation.columns] / formulation.unit
    certificate = certify_cone(program, x, 0.0)
    raise NotImplementedError(certificate, least)


def _residual_scale(formulation: Formulation, rows: ElasticRows) -> float:
    """Of joints alone, whose model error stands for noise where sigma is unknown [m]."""
    joints = formulation.joints
    R, z = formulation.fit.R[:, joints], formulation.fit.z
    x = np.linalg.lstsq(R, z, rcond=None)[0]
    freedom = max(1, rows.readings - len(joints))
    return float(np.linalg.norm(R @ x - z) / np.sqrt(freedom)) * formulation.size
